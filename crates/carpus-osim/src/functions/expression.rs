//! Formulas in named variables, as `ExpressionBasedCoordinateForce` (`q`, `qdot`) and `ExpressionBasedBushingForce`
//! hold them.
//!
//! The grammar is that of Lepton, the parser that OpenSim uses: numbers, variables, `+ - * / ^` (`^` binds to the
//! right and before a sign: `-q^2` is `-(q^2)`), functions, parentheses, and definitions behind semicolons
//! (`2*s;s=sin(q)`). White space does not count.

mod parser;
mod tree;

use std::sync::Arc;

use carpus_numerics::numerics::{Dual, Scalar};

pub use parser::ExpressionError;
use tree::{Binary, Function, Node, Operation, evaluate};
pub use tree::{Dialect, function_names};

/// Variables of [`Expression::parse`]: a coordinate and its speed.
const COORDINATE_VARIABLES: [&str; 2] = ["q", "qdot"];

/// A formula, read once and evaluated without allocation.
#[derive(Clone, Debug)]
pub struct Expression {
    root: Arc<Node>,
}

impl Expression {
    /// Reads a formula in `q` (a coordinate's value) and `qdot` (its speed).
    ///
    /// # Errors
    /// [`ExpressionError`].
    pub fn parse(text: &str) -> Result<Expression, ExpressionError> {
        Expression::parse_in(text, &COORDINATE_VARIABLES)
    }

    /// Reads a formula in given variables.
    ///
    /// # Errors
    /// [`ExpressionError`].
    pub fn parse_in(text: &str, variables: &[&str]) -> Result<Expression, ExpressionError> {
        Expression::parse_as(text, variables, Dialect::OpenSim)
    }

    /// Reads a formula in given variables and a dialect.
    ///
    /// # Errors
    /// [`ExpressionError`].
    pub fn parse_as(text: &str, variables: &[&str], dialect: Dialect) -> Result<Expression, ExpressionError> {
        Ok(Expression { root: parser::parse(text, variables, dialect)? })
    }

    /// Value at a coordinate and its speed; with derivatives if they carry them.
    pub fn value<S: Scalar>(&self, q: S, qdot: S) -> S {
        evaluate(&self.root, &[q, qdot])
    }

    /// Value at the variables that it was read in.
    pub fn value_at<S: Scalar>(&self, variables: &[S]) -> S {
        evaluate(&self.root, variables)
    }

    /// Derivative by variable `i`.
    ///
    /// - `n`: number of variables
    /// - `x`: the variables
    pub fn derivative_at(&self, n: usize, x: impl Fn(usize) -> f64, i: usize) -> f64 {
        let variable = |k: usize| if k == i { Dual::<1>::variable(x(k), 0) } else { Dual::from(x(k)) };
        let variables: Vec<Dual<1>> = (0..n).map(variable).collect();
        evaluate(&self.root, &variables).gradient[0]
    }

    /// Derivative by variables `i` and `j`: the central difference of the derivative by `i`.
    pub fn second_derivative_at(&self, n: usize, x: impl Fn(usize) -> f64, i: usize, j: usize) -> f64 {
        let step = f64::EPSILON.cbrt() * x(j).abs().max(1.0);
        let moved = |by: f64| self.derivative_at(n, |k| if k == j { x(k) + by } else { x(k) }, i);
        (moved(step) - moved(-step)) / (2.0 * step)
    }

    /// Whether a variable occurs in it.
    pub fn uses(&self, variable: usize) -> bool {
        self.root.any(&|n| matches!(n.operation, Operation::Variable(i) if i == variable))
    }

    /// Whether both variables occur in the argument of one wave (sine, cosine, tangent).
    pub fn waves_in(&self, one: usize, other: usize) -> bool {
        let has = |node: &Node, i: usize| node.any(&|n| matches!(n.operation, Operation::Variable(v) if v == i));
        self.root.any(&|n| match &n.operation {
            Operation::Function(Function::Sin | Function::Cos | Function::Tan, a) => has(a, one) && has(a, other),
            _ => false,
        })
    }

    /// Whether value or slope jump somewhere.
    pub fn has_kinks(&self) -> bool {
        use Function::{Abs, Delta, Hinge, Sign, Step};
        self.root.any(&|n| {
            matches!(
                n.operation,
                Operation::Function(Abs | Delta | Hinge | Sign | Step, _)
                    | Operation::Binary(Binary::Min | Binary::Max, ..)
            )
        })
    }

    /// The formula in the words of OpenSim.
    ///
    /// - `names`: what stands for each variable, a name or a number
    pub fn opensim_text(&self, names: &[String]) -> String {
        self.root.opensim_text(names)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(text: &str, q: f64, qdot: f64) -> f64 {
        Expression::parse(text).unwrap_or_else(|e| panic!("{text}: {e}")).value(q, qdot)
    }

    #[test]
    fn verif_grammar_binds_as_lepton() {
        let (q, v) = (0.7_f64, -1.3_f64);
        for (text, expected) in [
            ("1+2*3", 7.0),
            ("-q^2", -(q * q)),
            ("2^3^2", 512.0),
            ("8/2/2", 2.0),
            ("1-2-3", -4.0),
            ("-2*-q", 2.0 * q),
            ("2^-1", 0.5),
            ("1.5e-3*q", 1.5e-3 * q),
            (" 2 * ( q + qdot ) ", 2.0 * (q + v)),
            ("min(q,qdot)+max(q,qdot)", q + v),
            ("step(q)+step(qdot)+step(0)", 2.0),
            ("square(q)+cube(qdot)+recip(q)", q * q + v * v * v + 1.0 / q),
            ("abs(qdot)*tanh(qdot)", v.abs() * v.tanh()),
            ("2*a+b;a=b*q;b=3", 6.0 * q + 3.0),
            ("(qdot*qdot+1)^0.17", (v * v + 1.0).powf(0.17)),
            ("sin(q)^2+cos(q)^2+erf(0)+delta(1)", 1.0),
        ] {
            let found = at(text, q, v);
            assert!((found - expected).abs() < 1e-14, "{text}: {found} instead of {expected}");
        }
    }

    #[test]
    fn verif_the_extended_dialect_says_the_same_in_the_words_of_opensim() {
        let variables = ["q", "qdot", "A"];
        for text in [
            "A*sign(q)*(1-q^2)",
            "A*hinge(qdot-0.1)+hinge(q)",
            "-A*sin(2*pi*q)^2/(1+abs(qdot))",
            "min(q,A)*max(qdot,-q)+2^-q",
            "1e-7*A+tanh(-q/0.01)-3-4",
        ] {
            let formula = Expression::parse_as(text, &variables, Dialect::Extended).unwrap();
            let written = formula.opensim_text(&["q", "qdot", "(-0.3)"].map(String::from));
            let again = Expression::parse(&written).unwrap_or_else(|e| panic!("{written}: {e}"));
            for (q, v) in [(0.7, -1.3), (-0.4, 0.6), (0.0, 0.0), (1.1, 0.1)] {
                let (ours, theirs): (f64, f64) = (formula.value_at(&[q, v, -0.3]), again.value(q, v));
                assert!((ours - theirs).abs() <= 1e-15 * ours.abs(), "{text} as {written}: {ours} {theirs}");
            }
        }
        assert!(matches!(Expression::parse("sign(q)"), Err(ExpressionError::UnknownFunction { .. })));
        assert!(matches!(Expression::parse("pi"), Err(ExpressionError::UnknownVariable { .. })));
        let wave = Expression::parse_as("A*sin(qdot*q)+A", &variables, Dialect::Extended).unwrap();
        assert!(wave.waves_in(0, 1) && !wave.waves_in(0, 2) && wave.uses(2) && !wave.has_kinks());
        assert!(Expression::parse("abs(q)").unwrap().has_kinks());
    }

    #[test]
    fn verif_derivatives_match_differences() {
        let text =
            "0.3*exp(-4*(q+1))-tanh(qdot/0.3)*(1+0.25*exp(-square(qdot/0.1)))+atan(q)*sinh(qdot)+(qdot^2+q^2)^0.3";
        let formula = Expression::parse(text).unwrap();
        let (q, v, h) = (0.4, 0.2, 1e-6);
        let dual = formula.value(Dual::<2>::variable(q, 0), Dual::<2>::variable(v, 1));
        let by_q = (formula.value(q + h, v) - formula.value(q - h, v)) / (2.0 * h);
        let by_v = (formula.value(q, v + h) - formula.value(q, v - h)) / (2.0 * h);
        assert!((dual.gradient[0] - by_q).abs() < 1e-7, "{dual:?} {by_q}");
        assert!((dual.gradient[1] - by_v).abs() < 1e-7, "{dual:?} {by_v}");
    }

    #[test]
    fn verif_errors_say_what_is_wrong() {
        let error = |text: &str| Expression::parse(text).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(error("2*").contains("found the end"));
        assert!(error("2*(q").contains("expected \")\""));
        assert!(error("q q2").contains("no variable \"qq2\""));
        assert!(error("t+1").contains("no variable \"t\""));
        assert!(error("sine(q)").contains("no function \"sine\""));
        assert!(error("min(q)").contains("takes 2"));
        assert!(error("").contains("found the end"));
        assert!(error("1;2").contains("a definition"));
        assert!(error(&"(".repeat(100_000)).contains("more than"));
        assert!(error(&"-".repeat(100_000)).contains("more than"));
        let bomb = (0..40).map(|i| format!("x{i}=x{}+x{}", i + 1, i + 1)).collect::<Vec<_>>().join(";");
        assert!(error(&format!("x0;{bomb};x40=q")).contains("more than"));
    }
}
