//! Formulas in named variables, as `ExpressionBasedCoordinateForce` (`q`, `qdot`) and `ExpressionBasedBushingForce`
//! hold them.
//!
//! The grammar is that of Lepton, the parser that OpenSim uses: numbers, variables, `+ - * / ^` (`^` binds to the
//! right and before a sign: `-q^2` is `-(q^2)`), functions, parentheses, and definitions behind semicolons
//! (`2*s;s=sin(q)`). White space does not count.

use std::collections::HashMap;
use std::sync::Arc;

use carpus_numerics::numerics::Scalar;

/// Operations that a formula may have, definitions written out.
const MAX_OPERATIONS: usize = 10_000;
/// Operations within operations.
const MAX_DEPTH: usize = 200;

/// Why a formula cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ExpressionError {
    /// Something else had to stand there.
    #[error("expected {expected}, found {found} (character {position})")]
    Unexpected {
        /// What would have been right.
        expected: &'static str,
        /// What stands there.
        found: String,
        /// Which character, from 1, white space not counted.
        position: usize,
    },
    /// No such function.
    #[error("there is no function \"{name}\"; there are {FUNCTION_NAMES}")]
    UnknownFunction {
        /// As written.
        name: String,
    },
    /// No such variable.
    #[error("there is no variable \"{name}\"; there are {known}")]
    UnknownVariable {
        /// As written.
        name: String,
        /// The variables that there are.
        known: String,
    },
    /// A function with too many or too few arguments.
    #[error("{name} takes {expected} argument(s), found {found}")]
    ArgumentCount {
        /// The function.
        name: String,
        /// How many it takes.
        expected: usize,
        /// How many are given.
        found: usize,
    },
    /// More operations than anyone writes.
    #[error("the formula has more than {MAX_OPERATIONS} operations, or more than {MAX_DEPTH} within each other")]
    TooLarge,
}

const FUNCTION_NAMES: &str = "sqrt, exp, log, sin, cos, sec, csc, tan, cot, asin, acos, atan, sinh, cosh, tanh, erf, \
                              erfc, step, delta, square, cube, recip, min, max, abs";

/// Variables of [`Expression::parse`]: a coordinate and its speed.
const COORDINATE_VARIABLES: [&str; 2] = ["q", "qdot"];

/// Which functions and constants a formula may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dialect {
    /// Those of OpenSim.
    OpenSim,
    /// Those of OpenSim and `FURTHER_FUNCTIONS`, and the constant `pi`.
    Extended,
}

/// Functions that OpenSim does not have: the sign of a number (0 at 0), and a number where it is positive, else 0.
pub const FURTHER_FUNCTIONS: [&str; 2] = ["sign", "hinge"];

/// Names of all functions of a dialect.
pub fn function_names(dialect: Dialect) -> Vec<&'static str> {
    let further: &[&str] = if dialect == Dialect::Extended { &FURTHER_FUNCTIONS } else { &[] };
    FUNCTION_NAMES.split(", ").chain(further.iter().copied()).collect()
}

/// A formula, read once and evaluated without allocation.
#[derive(Clone, Debug)]
pub struct Expression {
    root: Arc<Node>,
}

#[derive(Debug)]
struct Node {
    operation: Operation,
    /// Operations in it, itself included.
    size: usize,
    depth: usize,
}

#[derive(Debug)]
enum Operation {
    Number(f64),
    Variable(usize),
    Function(Function, Arc<Node>),
    Binary(Binary, Arc<Node>, Arc<Node>),
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Function {
    Negate,
    Sqrt,
    Exp,
    Log,
    Sin,
    Cos,
    Sec,
    Csc,
    Tan,
    Cot,
    Asin,
    Acos,
    Atan,
    Sinh,
    Cosh,
    Tanh,
    Erf,
    Erfc,
    Step,
    Delta,
    Square,
    Cube,
    Recip,
    Abs,
    Sign,
    Hinge,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Binary {
    Add,
    Subtract,
    Multiply,
    Divide,
    Power,
    Min,
    Max,
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
        let text: Vec<char> = text.chars().filter(|c| !c.is_whitespace()).collect();
        let mut parts = text.split(|c| *c == ';');
        let main = parts.next().unwrap_or_default();
        let mut position = main.len() + 1;
        let mut definitions = Vec::new();
        for part in parts {
            let start = position;
            position += part.len() + 1;
            if part.is_empty() {
                continue;
            }
            let Some(equals) = part.iter().position(|c| *c == '=').filter(|at| *at > 0) else {
                return Err(unexpected("a definition NAME=FORMULA", part, 0, start));
            };
            definitions.push((part[..equals].iter().collect::<String>(), &part[equals + 1..], start + equals + 1));
        }
        let mut known = HashMap::new();
        // A definition may use those behind it.
        for (name, formula, start) in definitions.into_iter().rev() {
            let node = Parser { text: formula, start, at: 0, nesting: 0, known: &known, variables, dialect }.whole()?;
            known.insert(name, node);
        }
        let root = Parser { text: main, start: 0, at: 0, nesting: 0, known: &known, variables, dialect }.whole()?;
        Ok(Expression { root })
    }

    /// Value at a coordinate and its speed; with derivatives if they carry them.
    pub fn value<S: Scalar>(&self, q: S, qdot: S) -> S {
        evaluate(&self.root, &[q, qdot])
    }

    /// Value at the variables that it was read in.
    pub fn value_at<S: Scalar>(&self, variables: &[S]) -> S {
        evaluate(&self.root, variables)
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

impl Node {
    /// Whether this holds for it or for what is in it.
    fn any(&self, holds: &impl Fn(&Node) -> bool) -> bool {
        holds(self)
            || match &self.operation {
                Operation::Number(_) | Operation::Variable(_) => false,
                Operation::Function(_, a) => a.any(holds),
                Operation::Binary(_, a, b) => a.any(holds) || b.any(holds),
            }
    }

    fn opensim_text(&self, names: &[String]) -> String {
        match &self.operation {
            Operation::Number(value) => format!("{value:?}"),
            Operation::Variable(i) => names.get(*i).cloned().unwrap_or_default(),
            Operation::Function(function, a) => function.opensim(&format!("({})", a.opensim_text(names))),
            Operation::Binary(binary, a, b) => {
                let (a, b) = (a.opensim_text(names), b.opensim_text(names));
                match binary {
                    Binary::Add => format!("({a}+{b})"),
                    Binary::Subtract => format!("({a}-{b})"),
                    Binary::Multiply => format!("({a}*{b})"),
                    Binary::Divide => format!("({a}/{b})"),
                    Binary::Power => format!("(({a})^({b}))"),
                    Binary::Min => format!("min({a},{b})"),
                    Binary::Max => format!("max({a},{b})"),
                }
            }
        }
    }
}

fn evaluate<S: Scalar>(node: &Node, variables: &[S]) -> S {
    match &node.operation {
        Operation::Number(value) => S::constant(*value),
        Operation::Variable(i) => variables[*i],
        Operation::Function(function, argument) => function.apply(evaluate(argument, variables)),
        Operation::Binary(binary, a, b) => binary.apply(evaluate(a, variables), evaluate(b, variables)),
    }
}

impl Function {
    fn named(name: &str, dialect: Dialect) -> Option<Function> {
        Some(match name {
            "sign" if dialect == Dialect::Extended => Function::Sign,
            "hinge" if dialect == Dialect::Extended => Function::Hinge,
            "sqrt" => Function::Sqrt,
            "exp" => Function::Exp,
            "log" => Function::Log,
            "sin" => Function::Sin,
            "cos" => Function::Cos,
            "sec" => Function::Sec,
            "csc" => Function::Csc,
            "tan" => Function::Tan,
            "cot" => Function::Cot,
            "asin" => Function::Asin,
            "acos" => Function::Acos,
            "atan" => Function::Atan,
            "sinh" => Function::Sinh,
            "cosh" => Function::Cosh,
            "tanh" => Function::Tanh,
            "erf" => Function::Erf,
            "erfc" => Function::Erfc,
            "step" => Function::Step,
            "delta" => Function::Delta,
            "square" => Function::Square,
            "cube" => Function::Cube,
            "recip" => Function::Recip,
            "abs" => Function::Abs,
            _ => return None,
        })
    }

    fn apply<S: Scalar>(self, a: S) -> S {
        let x = a.value();
        let gaussian = |x: f64| std::f64::consts::FRAC_2_SQRT_PI * (-x * x).exp();
        match self {
            Function::Negate => -a,
            // A constant carries no derivative, however steep the root is at 0.
            Function::Sqrt if x == 0.0 => S::constant(0.0),
            Function::Sqrt => a.sqrt(),
            Function::Exp => a.exp(),
            Function::Log => a.ln(),
            Function::Sin => a.sin(),
            Function::Cos => a.cos(),
            Function::Sec => a.cos().recip(),
            Function::Csc => a.sin().recip(),
            Function::Tan => a.tan(),
            Function::Cot => a.tan().recip(),
            Function::Asin => a.asin(),
            Function::Acos => a.acos(),
            Function::Atan => a.chain(x.atan(), 1.0 / (1.0 + x * x)),
            Function::Sinh => a.chain(x.sinh(), x.cosh()),
            Function::Cosh => a.chain(x.cosh(), x.sinh()),
            Function::Tanh => a.chain(x.tanh(), 1.0 - x.tanh() * x.tanh()),
            Function::Erf => a.chain(statrs::function::erf::erf(x), gaussian(x)),
            Function::Erfc => a.chain(statrs::function::erf::erfc(x), -gaussian(x)),
            Function::Step => S::constant(if x >= 0.0 { 1.0 } else { 0.0 }),
            Function::Delta => S::constant(if x == 0.0 { 1.0 } else { 0.0 }),
            Function::Square => a * a,
            Function::Cube => a * a * a,
            Function::Recip => a.recip(),
            Function::Abs => a.abs(),
            Function::Sign => S::constant(if x == 0.0 { 0.0 } else { x.signum() }),
            Function::Hinge => a.max(S::constant(0.0)),
        }
    }

    /// In the words of OpenSim.
    fn opensim(self, argument: &str) -> String {
        let name = match self {
            Function::Negate => return format!("(-{argument})"),
            Function::Sign => return format!("(step({argument})-step(-{argument}))"),
            Function::Hinge => return format!("max({argument},0)"),
            Function::Sqrt => "sqrt",
            Function::Exp => "exp",
            Function::Log => "log",
            Function::Sin => "sin",
            Function::Cos => "cos",
            Function::Sec => "sec",
            Function::Csc => "csc",
            Function::Tan => "tan",
            Function::Cot => "cot",
            Function::Asin => "asin",
            Function::Acos => "acos",
            Function::Atan => "atan",
            Function::Sinh => "sinh",
            Function::Cosh => "cosh",
            Function::Tanh => "tanh",
            Function::Erf => "erf",
            Function::Erfc => "erfc",
            Function::Step => "step",
            Function::Delta => "delta",
            Function::Square => "square",
            Function::Cube => "cube",
            Function::Recip => "recip",
            Function::Abs => "abs",
        };
        format!("{name}({argument})")
    }
}

impl Binary {
    fn apply<S: Scalar>(self, a: S, b: S) -> S {
        match self {
            Binary::Add => a + b,
            Binary::Subtract => a - b,
            Binary::Multiply => a * b,
            Binary::Divide => a / b,
            Binary::Min => a.min(b),
            Binary::Max => a.max(b),
            Binary::Power => {
                let (x, p) = (a.value(), b.value());
                let value = x.powf(p);
                let by_base = if p == 0.0 || x == 0.0 && p < 1.0 { 0.0 } else { p * x.powf(p - 1.0) };
                // A constant exponent carries no derivative, whatever the logarithm of a negative base would be.
                let by_exponent = if x > 0.0 { value * x.ln() } else { 0.0 };
                a.chain(value, by_base) + b.chain(0.0, by_exponent)
            }
        }
    }
}

fn unexpected(expected: &'static str, text: &[char], at: usize, start: usize) -> ExpressionError {
    let found = match text.get(at) {
        Some(c) => format!("\"{c}\""),
        None => "the end".to_owned(),
    };
    ExpressionError::Unexpected { expected, found, position: start + at + 1 }
}

/// Recursive descent over one formula.
struct Parser<'a> {
    text: &'a [char],
    start: usize,
    at: usize,
    nesting: usize,
    known: &'a HashMap<String, Arc<Node>>,
    variables: &'a [&'a str],
    dialect: Dialect,
}

impl Parser<'_> {
    fn whole(mut self) -> Result<Arc<Node>, ExpressionError> {
        let node = self.sum()?;
        if self.at < self.text.len() {
            return Err(self.expected("an operator or the end"));
        }
        Ok(node)
    }

    fn expected(&self, what: &'static str) -> ExpressionError {
        unexpected(what, self.text, self.at, self.start)
    }

    fn take(&mut self, wanted: &[char]) -> Option<char> {
        let c = *self.text.get(self.at).filter(|c| wanted.contains(c))?;
        self.at += 1;
        Some(c)
    }

    fn sum(&mut self) -> Result<Arc<Node>, ExpressionError> {
        let mut left = self.product()?;
        while let Some(sign) = self.take(&['+', '-']) {
            let right = self.product()?;
            let operation = if sign == '+' { Binary::Add } else { Binary::Subtract };
            left = node(Operation::Binary(operation, left, right))?;
        }
        Ok(left)
    }

    fn product(&mut self) -> Result<Arc<Node>, ExpressionError> {
        let mut left = self.signed()?;
        while let Some(sign) = self.take(&['*', '/']) {
            let right = self.signed()?;
            let operation = if sign == '*' { Binary::Multiply } else { Binary::Divide };
            left = node(Operation::Binary(operation, left, right))?;
        }
        Ok(left)
    }

    /// A sign binds less than `^`.
    fn signed(&mut self) -> Result<Arc<Node>, ExpressionError> {
        self.nesting += 1;
        if self.nesting > MAX_DEPTH {
            return Err(ExpressionError::TooLarge);
        }
        let result = if self.take(&['-']).is_some() {
            let inner = self.signed()?;
            node(Operation::Function(Function::Negate, inner))
        } else {
            let base = self.value()?;
            if self.take(&['^']).is_some() {
                let exponent = self.signed()?;
                node(Operation::Binary(Binary::Power, base, exponent))
            } else {
                Ok(base)
            }
        };
        self.nesting -= 1;
        result
    }

    fn value(&mut self) -> Result<Arc<Node>, ExpressionError> {
        if self.take(&['(']).is_some() {
            let inner = self.sum()?;
            self.close()?;
            return Ok(inner);
        }
        match self.text.get(self.at) {
            Some(c) if c.is_ascii_digit() || *c == '.' => self.number(),
            Some(c) if c.is_alphabetic() || *c == '_' => self.named(),
            _ => Err(self.expected("a number, a variable, a function or \"(\"")),
        }
    }

    fn close(&mut self) -> Result<(), ExpressionError> {
        self.take(&[')']).map(|_| ()).ok_or_else(|| self.expected("\")\""))
    }

    fn number(&mut self) -> Result<Arc<Node>, ExpressionError> {
        let begin = self.at;
        let digit = |c: &char| c.is_ascii_digit() || *c == '.';
        while self.text.get(self.at).is_some_and(digit) {
            self.at += 1;
        }
        if self.text.get(self.at).is_some_and(|c| matches!(c, 'e' | 'E')) {
            self.at += 1;
            let _ = self.take(&['+', '-']);
            while self.text.get(self.at).is_some_and(char::is_ascii_digit) {
                self.at += 1;
            }
        }
        let text: String = self.text[begin..self.at].iter().collect();
        match text.parse() {
            Ok(value) => node(Operation::Number(value)),
            Err(_) => Err(unexpected("a number", self.text, begin, self.start)),
        }
    }

    fn named(&mut self) -> Result<Arc<Node>, ExpressionError> {
        let begin = self.at;
        while self.text.get(self.at).is_some_and(|c| c.is_alphanumeric() || *c == '_') {
            self.at += 1;
        }
        let name: String = self.text[begin..self.at].iter().collect();
        if self.take(&['(']).is_some() {
            return self.function(name);
        }
        if let Some(defined) = self.known.get(&name) {
            return Ok(Arc::clone(defined));
        }
        match self.variables.iter().position(|variable| *variable == name) {
            Some(i) => node(Operation::Variable(i)),
            None if name == "pi" && self.dialect == Dialect::Extended => node(Operation::Number(std::f64::consts::PI)),
            None => Err(ExpressionError::UnknownVariable { name, known: self.variables.join(", ") }),
        }
    }

    fn function(&mut self, name: String) -> Result<Arc<Node>, ExpressionError> {
        let mut arguments = vec![self.sum()?];
        while self.take(&[',']).is_some() {
            arguments.push(self.sum()?);
        }
        self.close()?;
        let found = arguments.len();
        let mut arguments = arguments.into_iter();
        let both = match name.as_str() {
            "min" => Some(Binary::Min),
            "max" => Some(Binary::Max),
            _ => None,
        };
        match (both, Function::named(&name, self.dialect), arguments.next(), arguments.next()) {
            (Some(binary), _, Some(a), Some(b)) if found == 2 => node(Operation::Binary(binary, a, b)),
            (Some(_), ..) => Err(ExpressionError::ArgumentCount { name, expected: 2, found }),
            (None, Some(function), Some(a), None) => node(Operation::Function(function, a)),
            (None, Some(_), ..) => Err(ExpressionError::ArgumentCount { name, expected: 1, found }),
            (None, None, ..) => Err(ExpressionError::UnknownFunction { name }),
        }
    }
}

fn node(operation: Operation) -> Result<Arc<Node>, ExpressionError> {
    let (size, depth) = match &operation {
        Operation::Number(_) | Operation::Variable(_) => (1, 1),
        Operation::Function(_, a) => (1 + a.size, 1 + a.depth),
        Operation::Binary(_, a, b) => (1 + a.size + b.size, 1 + a.depth.max(b.depth)),
    };
    if size > MAX_OPERATIONS || depth > MAX_DEPTH {
        return Err(ExpressionError::TooLarge);
    }
    Ok(Arc::new(Node { operation, size, depth }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use carpus_numerics::numerics::Dual;

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
