//! A formula as a tree of operations: its value and its text.

use std::sync::Arc;

use carpus_numerics::numerics::Scalar;

/// Functions that OpenSim has.
pub(super) const FUNCTION_NAMES: &str = "sqrt, exp, log, sin, cos, sec, csc, tan, cot, asin, acos, atan, sinh, cosh, \
                                         tanh, erf, erfc, step, delta, square, cube, recip, min, max, abs";

/// Which functions and constants a formula may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dialect {
    /// Those of OpenSim.
    OpenSim,
    /// Those of OpenSim and `FURTHER_FUNCTIONS`, and the constant `pi`.
    Extended,
}

/// Functions that OpenSim does not have: the sign of a number (0 at 0), and a number where it is positive, else 0.
const FURTHER_FUNCTIONS: [&str; 2] = ["sign", "hinge"];

/// Names of all functions of a dialect.
pub fn function_names(dialect: Dialect) -> Vec<&'static str> {
    let further: &[&str] = if dialect == Dialect::Extended { &FURTHER_FUNCTIONS } else { &[] };
    FUNCTION_NAMES.split(", ").chain(further.iter().copied()).collect()
}

#[derive(Debug)]
pub(super) struct Node {
    pub(super) operation: Operation,
    /// Operations in it, itself included.
    pub(super) size: usize,
    pub(super) depth: usize,
}

#[derive(Debug)]
pub(super) enum Operation {
    Number(f64),
    Variable(usize),
    Function(Function, Arc<Node>),
    Binary(Binary, Arc<Node>, Arc<Node>),
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Function {
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
pub(super) enum Binary {
    Add,
    Subtract,
    Multiply,
    Divide,
    Power,
    Min,
    Max,
}

impl Node {
    /// Whether this holds for it or for what is in it.
    pub(super) fn any(&self, holds: &impl Fn(&Node) -> bool) -> bool {
        holds(self)
            || match &self.operation {
                Operation::Number(_) | Operation::Variable(_) => false,
                Operation::Function(_, a) => a.any(holds),
                Operation::Binary(_, a, b) => a.any(holds) || b.any(holds),
            }
    }

    pub(super) fn opensim_text(&self, names: &[String]) -> String {
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

pub(super) fn evaluate<S: Scalar>(node: &Node, variables: &[S]) -> S {
    match &node.operation {
        Operation::Number(value) => S::constant(*value),
        Operation::Variable(i) => variables[*i],
        Operation::Function(function, argument) => function.apply(evaluate(argument, variables)),
        Operation::Binary(binary, a, b) => binary.apply(evaluate(a, variables), evaluate(b, variables)),
    }
}

impl Function {
    pub(super) fn named(name: &str, dialect: Dialect) -> Option<Function> {
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

    pub(super) fn apply<S: Scalar>(self, a: S) -> S {
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
    pub(super) fn opensim(self, argument: &str) -> String {
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
    pub(super) fn apply<S: Scalar>(self, a: S, b: S) -> S {
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
