//! Reading a formula: recursive descent, as Lepton does it.

use std::collections::HashMap;
use std::sync::Arc;

use super::tree::{Binary, Dialect, FUNCTION_NAMES, Function, Node, Operation};

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

/// The tree of a formula in given variables and a dialect, its definitions put in.
///
/// # Errors
/// [`ExpressionError`].
pub(super) fn parse(text: &str, variables: &[&str], dialect: Dialect) -> Result<Arc<Node>, ExpressionError> {
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
    Parser { text: main, start: 0, at: 0, nesting: 0, known: &known, variables, dialect }.whole()
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
