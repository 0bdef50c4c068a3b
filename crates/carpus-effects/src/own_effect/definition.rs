//! An effect as a laboratory writes it down: `my_effect.toml`.
//!
//! ```toml
//! [effect]
//! id = "cogging"
//! name = "Cogging of the machine"
//! stage = "joint"
//! formula = "A*sin(n*q)"
//!
//! [parameters.A]
//! unit = "N·m"
//! role = "amplitude"
//! plausible = [0.0, 1.0]
//! source = "bench test of the motor"
//!
//! [parameters.n]
//! unit = "1/rad"
//! role = "shape"
//! start = 14.0
//! plausible = [8.0, 20.0]
//! source = "poles of the motor"
//! ```

use std::path::{Path, PathBuf};

use super::unit;
use super::variable::{Place, Variable, named_in};
use crate::effect::Role;
use carpus_numerics::numerics::Dual;
use carpus_osim::functions::{Dialect, Expression, ExpressionError, function_names};
use carpus_study::study::{Fault, Problem, Sections, Severity, TomlSection, file_fault, nearest};

/// Share of the largest plausible size that is typical where the file does not say.
const TYPICAL_SIZE: f64 = 0.2;
/// Share of the plausible range that a shape typically differs by where the file does not say.
const TYPICAL_SHAPE: f64 = 0.25;
/// Points at which a formula is tried before it is used.
const TRIED: usize = 4000;
/// What a formula may be off from 0 where all amplitudes are 0 [N·m or 1].
const ABSENT: f64 = 1e-12;

/// A parameter as the file has it.
#[derive(Clone, Debug, PartialEq)]
pub struct DefinedParameter {
    /// Name in the formula.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// What it does.
    pub role: Role,
    /// Value without the effect (amplitudes: 0), or the usual shape.
    pub start: f64,
    /// A typical size; of a shape, the standard deviation that it is expected to have.
    pub typical: f64,
    /// Plausible range.
    pub plausible: [f64; 2],
    /// Values that a fit also starts from; `None`: as the formula calls for.
    pub starts: Option<Vec<f64>>,
    /// Where the range comes from.
    pub source: String,
}

/// An effect as the file has it, read and checked.
#[derive(Clone, Debug)]
pub struct Definition {
    /// The file.
    pub file: PathBuf,
    /// Its text.
    pub text: String,
    /// Identifier.
    pub id: String,
    /// How people call it.
    pub name: String,
    /// Where it acts.
    pub place: Place,
    /// Muscles that it acts on; `None`: all.
    pub muscles: Option<Vec<String>>,
    /// The formula as written.
    pub formula: String,
    /// Line of the formula.
    pub formula_line: usize,
    /// Line of the muscles.
    pub muscles_line: usize,
    /// How it shows in the residual.
    pub signature: String,
    /// The experiment that exposes it.
    pub experiment: String,
    /// Effects that look alike.
    pub rivals: Vec<String>,
    /// Its parameters.
    pub parameters: Vec<DefinedParameter>,
    /// What the formula reads, in the order in which it is given its values; parameters follow.
    pub variables: Vec<Variable>,
    /// The formula.
    pub expression: Expression,
}

impl PartialEq for Definition {
    /// The same text defines the same effect, wherever it stands.
    fn eq(&self, other: &Self) -> bool {
        self.text == other.text
    }
}

impl Definition {
    /// Reads a file.
    ///
    /// # Errors
    /// Every problem of the file.
    pub fn read(file: &Path) -> Result<Definition, Vec<Problem>> {
        let text = carpus_numerics::regular_file::read_text(file)
            .map_err(|e| vec![Problem::error(file, None, file_fault(&e, "effect of your own", None))])?;
        Definition::parse(&text, file)
    }

    /// Reads the text of a file.
    ///
    /// # Errors
    /// Every problem of the text.
    pub fn parse(text: &str, file: &Path) -> Result<Definition, Vec<Problem>> {
        let mut problems = Vec::new();
        let found = Self::sections(text, file, &mut problems);
        match found {
            Some(definition) if problems.iter().all(|p| p.severity != Severity::Error) => Ok(definition),
            _ => Err(problems),
        }
    }

    fn sections(text: &str, file: &Path, problems: &mut Vec<Problem>) -> Option<Definition> {
        let sections = Sections::parse(text, file, problems)?;
        let mut effect = sections.section("effect");
        let id = effect.required_string("id", "the effect's identifier: small letters and _");
        if let Some(id) = id.as_deref().filter(|id| !is_id(id)) {
            effect.bad_value("id", "small letters, digits and _, a letter first", id);
        }
        let name = effect.required_string("name", "the effect's name");
        let stages = [("joint", Place::Joint), ("muscles", Place::Muscles)];
        let is_there = effect.keys().iter().any(|k| k == "stage");
        if !is_there {
            effect.required_string("stage", "\"joint\": adds N·m; \"muscles\": multiplies their moment by 1 + formula");
        }
        let place = effect.optional_word("stage", "stage", &stages);
        let muscles = effect.optional_strings("muscles", "list of muscles");
        let muscles_line = effect.line_of("muscles");
        if muscles.is_some() && place == Some(Place::Joint) {
            effect.bad_value("muscles", "this key only with stage = \"muscles\"", "stage = \"joint\"");
        }
        let formula = effect.required_string("formula", "the formula");
        let formula_line = effect.line_of("formula");
        let signature = effect.optional_string("signature");
        let experiment = effect.optional_string("experiment");
        let rivals = effect.optional_strings("rivals", "list of effects").unwrap_or_default();
        effect.finish(problems);
        let mut listed = sections.section("parameters");
        if listed.is_empty() {
            listed.required_string("A", "a parameter: [parameters.A] with unit, role, plausible, source");
        }
        let parameters = listed.all_tables("a table: unit, role, plausible, source", parameter);
        listed.finish(problems);
        sections.report_unknown(problems);
        let parameters: Vec<DefinedParameter> = parameters.into_iter().collect::<Option<_>>()?;
        let (place, formula) = (place?, formula?);
        let at_formula = |fault| Problem::error(file, formula_line, fault);
        if parameters.iter().all(|p| p.role != Role::Amplitude) {
            let hint = "the size of the effect is the amplitude, as A in A*sin(n*q)";
            let fault = refused("role", "at least one parameter with role = \"amplitude\"", "none", hint.to_owned());
            problems.push(at_formula(fault));
            return None;
        }
        let names: Vec<&str> = parameters.iter().map(|p| p.name.as_str()).collect();
        let variables = named_in(&formula, &names, place);
        let mut words: Vec<String> = variables.iter().map(Variable::word).collect();
        words.extend(names.iter().map(|n| (*n).to_owned()));
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        let expression = match Expression::parse_as(&formula, &words, Dialect::Extended) {
            Ok(expression) => expression,
            Err(error) => {
                problems.push(at_formula(formula_fault(&error, &names, place)));
                return None;
            }
        };
        for (i, name) in names.iter().enumerate().filter(|(i, _)| !expression.uses(variables.len() + i)) {
            let hint = format!("use it in the formula, or take [parameters.{name}] out");
            let expected = format!("a formula with every parameter, {} among them", parameters[i].name);
            problems.push(at_formula(refused("formula", &expected, &format!("`{formula}`"), hint)));
        }
        let definition = Definition {
            file: file.to_owned(),
            text: text.to_owned(),
            id: id?,
            name: name?,
            place,
            muscles,
            signature: signature.unwrap_or_else(|| "as its formula".to_owned()),
            experiment: experiment
                .unwrap_or_else(|| "one that varies what the formula reads, all else held".to_owned()),
            rivals,
            formula,
            formula_line,
            muscles_line,
            parameters,
            variables,
            expression,
        };
        if problems.is_empty() {
            problems.extend(definition.fault_over_plausible_ranges().map(at_formula));
        }
        Some(definition)
    }

    /// Value and derivatives by the parameters of a point are numbers, and nothing is there where all amplitudes are 0.
    fn fault_over_plausible_ranges(&self) -> Option<Fault> {
        let choices: Vec<Vec<f64>> = self.variables.iter().map(|v| v.usual_values().to_vec()).collect();
        let count = self.variables.len();
        let of = |p: &DefinedParameter| {
            let mut values = vec![p.plausible[0], p.plausible[1]];
            values.push(if p.role == Role::Amplitude { p.typical } else { p.start });
            values
        };
        let choices: Vec<Vec<f64>> = choices.into_iter().chain(self.parameters.iter().map(of)).collect();
        let all = choices.iter().fold(1_usize, |n, c| n.saturating_mul(c.len()));
        let mut state = 1_u64;
        for point in 0..all.min(TRIED) {
            let mut place = point;
            let mut pick = |choice: &Vec<f64>| {
                if all <= TRIED {
                    let i = place % choice.len();
                    place /= choice.len();
                    return choice[i];
                }
                // Knuth's linear congruential generator: which points are tried is the same every time.
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                choice[(state >> 33) as usize % choice.len()]
            };
            let values: Vec<f64> = choices.iter().map(&mut pick).collect();
            let derivatives = (0..self.parameters.len()).map(|p| self.derivative(&values, p));
            let value: f64 = self.expression.value_at(&values);
            if !value.is_finite() || derivatives.into_iter().any(|d| !d.is_finite()) {
                let found = if value.is_finite() { "a derivative that is none".to_owned() } else { format!("{value}") };
                let hint = "what it divides by, and the argument of a root or logarithm, must not be 0 or negative \
                            there: \
                            narrow a plausible range, or add a small number";
                let found = format!("{found} at {}", self.told(&values));
                return Some(refused("formula", "a number over all plausible ranges", &found, hint.to_owned()));
            }
            let mut absent = values.clone();
            for (value, p) in absent[count..].iter_mut().zip(&self.parameters) {
                if p.role == Role::Amplitude {
                    *value = 0.0;
                }
            }
            let left: f64 = self.expression.value_at(&absent);
            if !(left.abs() <= ABSENT) {
                let expected = "0 where every amplitude is 0: the effect is then absent";
                let found = format!("{left:.6} at {}", self.told(&absent));
                let hint = "multiply all of it by an amplitude".to_owned();
                return Some(refused("formula", expected, &found, hint));
            }
        }
        None
    }

    /// Derivative by a parameter at values of the variables, then the parameters.
    pub fn derivative(&self, values: &[f64], parameter: usize) -> f64 {
        let at = self.variables.len() + parameter;
        let dual = |(i, v): (usize, &f64)| if i == at { Dual::variable(*v, 0) } else { Dual::from(*v) };
        let values: Vec<Dual<1>> = values.iter().enumerate().map(dual).collect();
        self.expression.value_at(&values).gradient[0]
    }

    /// Values by name.
    fn told(&self, values: &[f64]) -> String {
        let words = self.variables.iter().map(Variable::word).chain(self.parameters.iter().map(|p| p.name.clone()));
        words.zip(values).map(|(word, value)| format!("{word} = {value}")).collect::<Vec<_>>().join(", ")
    }

    /// Muscles that the formula or the file names and a study does not have, with what to do.
    ///
    /// - `active`: the study's active muscles
    pub fn unknown_muscles(&self, active: &[String]) -> Vec<Problem> {
        let read = self.variables.iter().filter_map(Variable::muscle).map(|m| (m, "formula", self.formula_line));
        let listed = self.muscles.iter().flatten().map(|m| (m.as_str(), "muscles", self.muscles_line));
        let unknown = read.chain(listed).filter(|(m, ..)| !active.iter().any(|a| a == m));
        let problem = |(muscle, key, line): (&str, &str, usize)| {
            let hint = match nearest(muscle, active.iter().map(String::as_str)) {
                Some(near) => format!("did you mean `{near}`?"),
                None => format!("the study's active muscles are {}", active.join(", ")),
            };
            let expected = "a muscle that the study activates";
            Problem::error(&self.file, line, refused(key, expected, &format!("`{muscle}`"), hint))
        };
        unknown.map(problem).collect()
    }
}

fn is_id(id: &str) -> bool {
    id.starts_with(|c: char| c.is_ascii_lowercase())
        && id.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_')
}

fn refused(key: &str, expected: &str, found: &str, hint: String) -> Fault {
    Fault::Refused { key: key.to_owned(), expected: expected.to_owned(), found: found.to_owned(), hint }
}

/// What is wrong with a formula, with the nearest word that is right.
fn formula_fault(error: &ExpressionError, parameters: &[&str], place: Place) -> Fault {
    let known = || place.words().into_iter().chain(parameters.iter().copied());
    match error {
        ExpressionError::UnknownVariable { name, .. } => {
            let all = known().collect::<Vec<_>>().join(", ");
            let (expected, of_muscles) = ("a variable, a parameter or pi".to_owned(), place.words_of_muscles());
            let hint = match (nearest(name, known()), name.as_str()) {
                (_, name) if name.starts_with("F_") => {
                    "the force of a tendon depends on the parameters that are fitted beside the effect and cannot be \
                     read: take \
                     tau, the muscles' moment, or an activation"
                        .to_owned()
                }
                (Some(near), _) => format!("did you mean `{near}`?"),
                (None, _) => format!("there are {all}{of_muscles}"),
            };
            refused("formula", &expected, &format!("`{name}`"), hint)
        }
        ExpressionError::UnknownFunction { name } => {
            let all = function_names(Dialect::Extended);
            let hint = match nearest(name, all.iter().copied()) {
                Some(near) => format!("did you mean `{near}`? there are {}", all.join(", ")),
                None => format!("there are {}", all.join(", ")),
            };
            refused("formula", "a function", &format!("`{name}`"), hint)
        }
        other => {
            let hint = "as in A*sin(n*q); powers are written with ^, products with *".to_owned();
            refused("formula", "a formula", &other.to_string(), hint)
        }
    }
}

/// Reads one table of `[parameters]`.
fn parameter(name: &str, _line: usize, table: &mut TomlSection) -> Option<DefinedParameter> {
    let roles = [("amplitude", Role::Amplitude), ("shape", Role::Shape)];
    if !table.keys().iter().any(|k| k == "role") {
        table.required_string("role", "\"amplitude\" (the effect is absent at 0) or \"shape\"");
    }
    let role = table.optional_word("role", "role", &roles);
    let unit = table.required_string("unit", "a unit of SI, as \"N·m/rad\"; \"1\" for a plain number");
    let spelled = unit.as_deref().map(unit::spelled);
    if let (Some(Err(wrong)), Some(unit)) = (&spelled, &unit) {
        table.bad_value(
            "unit",
            "a unit of SI made of N, m, s, rad, kg, as \"N·m·s/rad\"; \"1\" for a plain number",
            &format!("`{wrong}` in `{unit}`"),
        );
    }
    if !table.keys().iter().any(|k| k == "plausible") {
        table.required_string("plausible", "[least, largest]");
    }
    let plausible = table.optional_pair("plausible", "[least, largest], the first smaller", |[a, b]| a < b);
    let [low, high] = plausible.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
    let start = table.optional_number("start", "a number within the plausible range", |v| (low..=high).contains(&v));
    let typical = table.optional_number("typical", "a positive number", |v| v > 0.0);
    let source = table.required_string("source", "where the plausible range comes from");
    let starts = table.optional_numbers("starts", "numbers within the plausible range", |v| (low..=high).contains(&v));
    if !is_word(name) {
        let expected = "a parameter's name of letters, digits and _ that is no variable, function or pi";
        table.bad_value(name, expected, &format!("`{name}`"));
    }
    match role {
        Some(Role::Amplitude) => {
            if start.is_some_and(|v| v != 0.0) {
                table.bad_value("start", "0: an amplitude is 0 without the effect", "another number");
            }
            if !(low <= 0.0 && high >= 0.0) {
                table.bad_value(
                    "plausible",
                    "a range that holds 0: an amplitude is 0 without the effect",
                    "one that does not",
                );
            }
            if starts.is_some() {
                table.bad_value("starts", "this key only with role = \"shape\"", "role = \"amplitude\"");
            }
        }
        Some(Role::Shape) if start.is_none() && !table.keys().iter().any(|k| k == "start") => {
            table.required_string("start", "the usual value of the shape");
        }
        _ => {}
    }
    let (role, plausible) = (role?, plausible?);
    let usual = match role {
        Role::Amplitude => TYPICAL_SIZE * plausible[0].abs().max(plausible[1].abs()),
        Role::Shape => TYPICAL_SHAPE * (plausible[1] - plausible[0]),
    };
    let start = if role == Role::Amplitude { 0.0 } else { start? };
    let unit = spelled?.ok()?;
    Some(DefinedParameter {
        name: name.to_owned(),
        unit,
        role,
        start,
        typical: typical.unwrap_or(usual),
        plausible,
        starts,
        source: source?,
    })
}

/// Whether a parameter may have this name.
fn is_word(name: &str) -> bool {
    let plain = name.starts_with(|c: char| c.is_ascii_alphabetic())
        && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_');
    let taken = function_names(Dialect::Extended).contains(&name)
        || Place::Joint.words().contains(&name)
        || Place::Muscles.words().contains(&name)
        || ["pi", "id", "definition"].contains(&name);
    plain && !taken
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOUND: &str = "[effect]\nid = \"drag\"\nname = \"Drag\"\nstage = \"joint\"\nformula \
                         = \"-b*abs(qdot)^p*sign(qdot)\"\n\n\
                         [parameters.b]\nunit = \"N·m·(s/rad)\"\nrole = \"amplitude\"\nplausible = [0, 1]\nsource \
                         = \"a guess\"\n\n\
                         [parameters.p]\nunit = \"1\"\nrole = \"shape\"\nstart = 0.5\nplausible = [0.1, 2]\nsource \
                         = \"a guess\"\n";

    fn parsed(text: &str) -> Result<Definition, Vec<Problem>> {
        Definition::parse(text, Path::new("drag.toml"))
    }

    /// All problems of the example with something replaced.
    fn problems(from: &str, to: &str) -> String {
        assert!(SOUND.contains(from), "{from}");
        match parsed(&SOUND.replacen(from, to, 1)) {
            Ok(_) => String::new(),
            Err(problems) => problems.iter().map(|p| format!("{p}\n")).collect(),
        }
    }

    #[test]
    fn verif_a_file_is_read_in_full() {
        let read = parsed(SOUND).unwrap_or_else(|p| panic!("{p:?}"));
        assert_eq!((read.id.as_str(), read.name.as_str(), read.formula_line), ("drag", "Drag", 5));
        assert_eq!(read.variables, [Variable::Plain(super::super::variable::Plain::Speed)]);
        let [b, p] = read.parameters.as_slice() else { panic!() };
        assert_eq!((b.role, b.start, b.typical, b.plausible), (Role::Amplitude, 0.0, 0.2, [0.0, 1.0]));
        assert_eq!((p.role, p.start, p.typical), (Role::Shape, 0.5, 0.475));
        let value: f64 = read.expression.value_at(&[-4.0, 0.3, 0.5]);
        assert!((value - 0.6).abs() < 1e-15);
    }

    #[test]
    fn verif_derivatives_by_parameters_are_exact() {
        let read = parsed(SOUND).unwrap();
        for (speed, b, p) in [(-4.0, 0.3, 0.5), (0.7, 0.2, 1.3), (0.0, 0.2, 0.4)] {
            let found = [0, 1].map(|i| read.derivative(&[speed, b, p], i));
            let unit = if speed == 0.0 { 0.0 } else { -f64::abs(speed).powf(p) * f64::signum(speed) };
            let by_p = if speed == 0.0 { 0.0 } else { b * unit * f64::abs(speed).ln() };
            assert!((found[0] - unit).abs() < 1e-14 && (found[1] - by_p).abs() < 1e-14, "{found:?} {unit} {by_p}");
        }
    }

    #[test]
    fn verif_what_is_wrong_is_told_with_line_expectation_and_hint() {
        for (from, to, says) in [
            (
                "abs(qdot)",
                "abs(qdott)",
                vec!["drag.toml:5: `formula`: expected a variable", "found `qdott`", "did you mean `qdot`?"],
            ),
            (
                "abs(qdot)",
                "abss(qdot)",
                vec!["drag.toml:5:", "expected a function, found `abss`", "did you mean `abs`?"],
            ),
            ("abs(qdot)", "abs(F_FCR)", vec!["drag.toml:5:", "found `F_FCR`", "take tau"]),
            ("-b*abs", "-b*(abs", vec!["drag.toml:5:", "expected \")\", found the end"]),
            ("-b*abs(qdot)^p", "-b/qdot*p", vec!["drag.toml:5:", "at qdot = 0", "narrow a plausible range"]),
            ("-b*abs(qdot)^p", "-b*log(p-0.1)*qdot", vec!["drag.toml:5:", "p = 0.1"]),
            (
                "-b*abs(qdot)^p",
                "p-b",
                vec!["drag.toml:5:", "0 where every amplitude is 0", "multiply all of it by an amplitude"],
            ),
            ("^p*sign(qdot)", "", vec!["drag.toml:5:", "every parameter, p among them"]),
            ("id = \"drag\"", "id = \"Drag\"", vec!["drag.toml:2: `id`: expected small letters"]),
            ("id = \"drag\"\n", "", vec!["drag.toml:1: [effect]", "id"]),
            ("\"joint\"", "\"sensor\"", vec!["drag.toml:4: `stage`", "joint, muscles"]),
            ("\"amplitude\"", "\"size\"", vec!["drag.toml:9: `role`", "amplitude, shape"]),
            ("\"amplitude\"", "\"shape\"\nstart = 0.1", vec!["at least one parameter with role = \"amplitude\""]),
            ("N·m·(s/rad)", "N·m·s/deg", vec!["drag.toml:8: `unit`: expected a unit of SI", "found `deg`"]),
            ("[0, 1]", "[1, 0]", vec!["drag.toml:10: `plausible`"]),
            ("[0, 1]", "[0.1, 1]", vec!["drag.toml:10: `plausible`: expected a range that holds 0"]),
            (
                "start = 0.5",
                "start = 5",
                vec!["drag.toml:16: `start`: expected a number within the plausible range, found 5"],
            ),
            ("start = 0.5\n", "", vec!["the usual value of the shape"]),
            ("source = \"a guess\"\n\n", "", vec!["where the plausible range comes from"]),
            ("source", "sourse", vec!["unknown key", "did you mean `source`?"]),
            ("parameters.p", "parameters.sin", vec!["drag.toml:13: `sin`: expected a parameter's name"]),
            ("[parameters.p]", "[parameter.p]", vec!["did you mean [parameters]?"]),
            ("stage = \"joint\"", "stage = \"muscles\"", vec!["drag.toml:5:", "found `qdot`", "a and moment arm r"]),
            ("formula", "muscles = [\"FCR\"]\nformula", vec!["only with stage = \"muscles\""]),
        ] {
            let found = problems(from, to);
            for part in says {
                assert!(found.contains(part), "{from} → {to}: {part}\n{found}");
            }
        }
        assert!(!problems("[effect]", "[effect").is_empty());
        assert!(Definition::read(Path::new("nowhere/drag.toml")).is_err());
    }

    #[test]
    fn verif_any_change_of_a_byte_is_read_or_refused() {
        let bytes = SOUND.as_bytes();
        for at in 0..bytes.len() {
            for byte in [b' ', b'9', b'(', b'"', b'=', b'\n', b'e'] {
                let mut text = bytes.to_vec();
                text[at] = byte;
                if let Ok(text) = String::from_utf8(text) {
                    let _ = parsed(&text);
                }
            }
        }
    }

    #[test]
    fn verif_muscles_that_a_study_lacks_are_told() {
        let text = SOUND.replace("abs(qdot)", "abs(qdot*a_FCR)");
        let read = parsed(&text).unwrap_or_else(|p| panic!("{p:?}"));
        let active = ["FCR", "ECU"].map(String::from);
        assert!(read.unknown_muscles(&active).is_empty());
        let found = read.unknown_muscles(&active[1..]);
        assert!(found.len() == 1 && found[0].line == Some(5), "{found:?}");
        assert!(found[0].to_string().contains("the study's active muscles are ECU"), "{}", found[0]);
    }
}
