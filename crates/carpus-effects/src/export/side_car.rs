//! `effects.toml`: what stands beside a model because no component of stock OpenSim does it.
//!
//! ```text
//! schema = "carpus.effects/1"
//! coordinate = "flexion"
//!
//! [[effect]]
//! id = "electromechanical_delay"
//! delay = { value = 0.06, unit = "s" }
//! ```
//!
//! An effect that is not of the catalogue brings its definition along: `definition = '''` and the text of the
//! laboratory's file.
//!
//! A change of the muscles' properties is a ratio, kept as its logarithm (unit `ln(ratio)`): the file does not know the
//! muscles.

use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::catalogue::{effect, with_own};
use crate::effect::{Parameter, Quantity};
use crate::forward_model::Setting;
use crate::own_effect::{Definition, TakenId, definition, register};
use carpus_osim::osim::error::nearest;
use carpus_study::study::Problem;
use carpus_study::study::write::toml_string;

/// Schema of the file.
pub const SIDE_CAR_SCHEMA: &str = "carpus.effects/1";
/// Unit of a change of a muscle's property: the natural logarithm of the ratio to what the model has.
const LOG_RATIO: &str = "ln(ratio)";

/// Unit in which the file gives a parameter.
fn unit_of(parameter: &Parameter) -> &'static str {
    match parameter.quantity {
        Quantity::Itself => parameter.unit,
        Quantity::LogRatio => LOG_RATIO,
    }
}

/// Effects beside a model.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SideCar {
    /// The coordinate that they are about.
    pub coordinate: String,
    /// The effects, in the order in which they were given.
    pub effects: Vec<Setting>,
}

/// What is wrong with a side-car.
#[derive(Debug, Error)]
pub enum SideCarError {
    /// The file cannot be read.
    #[error("{}: {source}", .file.display())]
    Unreadable {
        /// The file.
        file: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Not TOML.
    #[error("{}: {source}", .file.display())]
    NotToml {
        /// The file.
        file: PathBuf,
        /// Where and why.
        source: Box<toml::de::Error>,
    },
    /// A key is missing, superfluous, or of another type.
    #[error("{}: {at}: expected {expected}, found {found}", .file.display())]
    Unexpected {
        /// The file.
        file: PathBuf,
        /// Where in the file.
        at: String,
        /// What should be there.
        expected: String,
        /// What is there.
        found: String,
    },
    /// A property of the muscles itself where its change belongs.
    #[error("{}: {parameter}.unit: expected \"{LOG_RATIO}\", found \"{found}\"", .file.display())]
    PropertyItself {
        /// The file.
        file: PathBuf,
        /// The parameter, as `effect.parameter`.
        parameter: String,
        /// The unit, that of the property.
        found: &'static str,
    },
    /// No such effect.
    #[error("{}: there is no effect \"{id}\"", .file.display())]
    UnknownEffect {
        /// The file.
        file: PathBuf,
        /// As written.
        id: String,
        /// The most similar identifier.
        nearest: Option<String>,
    },
    /// A definition that cannot be read.
    #[error("{}: {effect}: the definition, line {}: {}", .file.display(), .problem.line.unwrap_or(1), .problem.fault)]
    BadDefinition {
        /// The file.
        file: PathBuf,
        /// The effect.
        effect: String,
        /// The first problem.
        problem: Box<Problem>,
    },
    /// Another effect of the same identifier.
    #[error("{}: {taken}", .file.display())]
    Taken {
        /// The file.
        file: PathBuf,
        /// By which.
        taken: TakenId,
    },
}

impl SideCarError {
    /// What to do about it.
    pub fn hint(&self) -> Option<String> {
        match self {
            SideCarError::UnknownEffect { nearest: Some(nearest), .. } => Some(format!("did you mean \"{nearest}\"?")),
            SideCarError::UnknownEffect { .. } => Some("carpus effects lists them".to_owned()),
            SideCarError::PropertyItself { .. } => Some(format!(
                "value is the natural logarithm of the ratio to what the model's muscles have: for 0.8 times that {{ \
                 value = \
                 -0.22314, unit = \"{LOG_RATIO}\" }}"
            )),
            SideCarError::BadDefinition { problem, .. } => problem.hint(),
            SideCarError::Taken { .. } => Some("give one of the two another id".to_owned()),
            _ => None,
        }
    }
}

impl SideCar {
    /// The file's text.
    pub fn to_toml(&self) -> String {
        let mut text =
            String::from("# Effects that no component of stock OpenSim has; read together with the model.\n");
        text.push_str(&format!(
            "schema = {}\ncoordinate = {}\n",
            toml_string(SIDE_CAR_SCHEMA),
            toml_string(&self.coordinate)
        ));
        for item in &self.effects {
            let description = item.effect.description();
            text.push_str(&format!("\n# {}: {}\n", description.name, description.equation));
            text.push_str(&format!("[[effect]]\nid = {}\n", toml_string(description.id)));
            for (parameter, value) in description.parameters.iter().zip(&item.values) {
                let unit = toml_string(unit_of(parameter));
                text.push_str(&format!("{} = {{ value = {value:?}, unit = {unit} }}\n", parameter.name));
            }
            if let Some(definition) = definition(item.effect) {
                text.push_str(&format!("definition = {}\n", lines_quoted(&definition.text)));
            }
        }
        text
    }

    /// Reads a file.
    ///
    /// # Errors
    /// [`SideCarError`].
    pub fn read(file: &Path) -> Result<SideCar, SideCarError> {
        let text = carpus_numerics::regular_file::read_text(file)
            .map_err(|source| SideCarError::Unreadable { file: file.to_owned(), source })?;
        SideCar::parse(&text, file)
    }

    /// Reads the text of a file.
    ///
    /// # Errors
    /// [`SideCarError`].
    pub fn parse(text: &str, file: &Path) -> Result<SideCar, SideCarError> {
        let table: toml::Table =
            text.parse().map_err(|source| SideCarError::NotToml { file: file.to_owned(), source: Box::new(source) })?;
        Reader { file }.side_car(&table)
    }
}

/// A string of several lines, as it is where TOML allows it.
fn lines_quoted(text: &str) -> String {
    let is_plain = |c: char| !c.is_control() || c == '\n' || c == '\t';
    if text.contains("'''") || text.ends_with('\'') || !text.chars().all(is_plain) {
        return toml_string(text);
    }
    format!("'''\n{text}'''")
}

struct Reader<'a> {
    file: &'a Path,
}

impl Reader<'_> {
    fn unexpected(&self, at: &str, expected: impl Into<String>, found: Option<&toml::Value>) -> SideCarError {
        SideCarError::Unexpected {
            file: self.file.to_owned(),
            at: at.to_owned(),
            expected: expected.into(),
            found: found.map_or_else(|| "nothing".to_owned(), |v| format!("{v:?}")),
        }
    }

    fn text<'t>(&self, table: &'t toml::Table, key: &str, at: &str) -> Result<&'t str, SideCarError> {
        let value = table.get(key);
        value.and_then(toml::Value::as_str).ok_or_else(|| self.unexpected(&format!("{at}{key}"), "a text", value))
    }

    /// Refuses keys that nobody reads.
    fn only(&self, table: &toml::Table, allowed: &[&str], at: &str) -> Result<(), SideCarError> {
        match table.keys().find(|key| !allowed.contains(&key.as_str())) {
            Some(key) => Err(self.unexpected(at, format!("only {}", allowed.join(", ")), Some(&key.as_str().into()))),
            None => Ok(()),
        }
    }

    fn side_car(&self, table: &toml::Table) -> Result<SideCar, SideCarError> {
        self.only(table, &["schema", "coordinate", "effect"], "the file")?;
        if self.text(table, "schema", "")? != SIDE_CAR_SCHEMA {
            return Err(self.unexpected("schema", toml_string(SIDE_CAR_SCHEMA), table.get("schema")));
        }
        let coordinate = self.text(table, "coordinate", "")?.to_owned();
        let mut effects = Vec::new();
        let listed = match table.get("effect") {
            None => &[],
            Some(toml::Value::Array(items)) => items.as_slice(),
            other => return Err(self.unexpected("effect", "[[effect]] sections", other)),
        };
        for (i, item) in listed.iter().enumerate() {
            let at = format!("effect {}", i + 1);
            let table = item.as_table().ok_or_else(|| self.unexpected(&at, "a section", Some(item)))?;
            effects.push(self.effect(table, &at)?);
        }
        Ok(SideCar { coordinate, effects })
    }

    /// Makes the effect of a definition known.
    fn define(&self, text: &str, id: &str) -> Result<(), SideCarError> {
        let (file, effect) = (self.file.to_owned(), id.to_owned());
        let definition = Definition::parse(text, self.file).map_err(|mut problems| match problems.is_empty() {
            true => SideCarError::UnknownEffect { file: file.clone(), id: effect.clone(), nearest: None },
            false => {
                let problem = Box::new(problems.swap_remove(0));
                SideCarError::BadDefinition { file: file.clone(), effect, problem }
            }
        })?;
        if definition.id != id {
            let found = toml::Value::from(definition.id.as_str());
            return Err(self.unexpected(&format!("{id}.definition: id"), toml_string(id), Some(&found)));
        }
        register(definition).map(|_| ()).map_err(|taken| SideCarError::Taken { file, taken })
    }

    fn effect(&self, table: &toml::Table, at: &str) -> Result<Setting, SideCarError> {
        let id = self.text(table, "id", &format!("{at}: "))?;
        if table.contains_key("definition") {
            self.define(self.text(table, "definition", &format!("{id}: "))?, id)?;
        }
        let Some(effect) = effect(id) else {
            return Err(SideCarError::UnknownEffect {
                file: self.file.to_owned(),
                id: id.to_owned(),
                nearest: nearest(id, with_own().iter().map(|e| e.description().id)),
            });
        };
        let parameters = effect.description().parameters;
        let definition = definition(effect).map(|_| "definition");
        let names = parameters.iter().map(|p| p.name);
        let allowed: Vec<&str> = std::iter::once("id").chain(definition).chain(names).collect();
        self.only(table, &allowed, id)?;
        let mut values = Vec::with_capacity(parameters.len());
        for parameter in parameters {
            let at = format!("{id}.{}", parameter.name);
            let unit = unit_of(parameter);
            let given = table.get(parameter.name);
            let inner = given.and_then(toml::Value::as_table);
            let Some(inner) = inner else {
                let expected = format!("{{ value = …, unit = {} }}", toml_string(unit));
                return Err(self.unexpected(&at, expected, given));
            };
            self.only(inner, &["value", "unit"], &at)?;
            let found = self.text(inner, "unit", &format!("{at}."))?;
            if found != unit && found == parameter.unit {
                let (file, found) = (self.file.to_owned(), parameter.unit);
                return Err(SideCarError::PropertyItself { file, parameter: at, found });
            }
            if found != unit {
                return Err(self.unexpected(&format!("{at}.unit"), toml_string(unit), inner.get("unit")));
            }
            let value = match inner.get("value") {
                Some(toml::Value::Float(value)) if value.is_finite() => *value,
                Some(toml::Value::Integer(value)) => *value as f64,
                other => return Err(self.unexpected(&format!("{at}.value"), "a finite number", other)),
            };
            values.push(value);
        }
        Ok(Setting { effect, values })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::catalogue::CATALOGUE;
    use crate::effect::Effect;
    use carpus_osim::osim::OsimFile;

    const HEAD: &str = "schema = \"carpus.effects/1\"\ncoordinate = \"flexion\"\n";

    #[test]
    fn verif_what_depends_on_the_muscles_is_a_logarithm_of_a_ratio() {
        let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("models/wrist.osim");
        let muscles = OsimFile::read(path).unwrap().spec.muscles;
        for &effect in CATALOGUE.iter() {
            let d = effect.description();
            let values = vec![0.25; d.parameters.len()];
            let depends = effect.reported(&values, &muscles) != values;
            assert_eq!(effect.has_log_ratios(), depends, "{}", d.id);
            let [own, more] = [0.0, 0.25].map(|ratio| effect.reported(&vec![ratio; values.len()], &muscles));
            for (one, more) in own.iter().zip(&more) {
                assert!(!depends || (more / one / 0.25_f64.exp() - 1.0).abs() < 1e-12, "{}", d.id);
            }
        }
    }

    #[test]
    fn verif_every_effect_is_read_as_it_was_written() {
        let setting = |e: &&'static dyn Effect| {
            let count = e.description().parameters.len();
            Setting { effect: *e, values: (0..count).map(|i| 0.1 / (i as f64 + 3.0)).collect() }
        };
        let written = SideCar { coordinate: "flexion".to_owned(), effects: CATALOGUE.iter().map(setting).collect() };
        let text = written.to_toml();
        assert_eq!(SideCar::parse(&text, Path::new("effects.toml")).unwrap(), written);
        assert!(
            text.contains("max_contraction_velocity = { value = 0.03333333333333333, unit = \"ln(ratio)\" }"),
            "{text}"
        );
    }

    #[test]
    fn verif_an_effect_of_a_laboratory_brings_its_definition_along() {
        let definition = "[effect]\nid = \"side_car_spring\"\nname = \"Spring\"\nstage = \"joint\"\nformula = \
                          \"-k*q^3\"\n\n[parameters.k]\nunit = \"N·m/rad\"\nrole = \"amplitude\"\nplausible = [0, \
                          2]\nsource = \"a guess\"\n";
        let text = format!(
            "{HEAD}[[effect]]\nid = \"side_car_spring\"\nk = {{ value = 0.5, unit = \"N·m/rad\" }}\ndefinition = {}\n",
            lines_quoted(definition)
        );
        let read = SideCar::parse(&text, Path::new("effects.toml")).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(read.effects[0].values, [0.5]);
        let again = SideCar::parse(&read.to_toml(), Path::new("effects.toml")).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(again, read);
        assert_eq!(crate::own_effect::definition(again.effects[0].effect).map(|d| d.text.as_str()), Some(definition));
        let error = |text: &str| SideCar::parse(text, Path::new("effects.toml")).unwrap_err();
        let other = error(&text.replace("-k*q^3", "-k*q^5"));
        assert!(other.to_string().contains("expected one definition of `side_car_spring`"), "{other}");
        let unreadable = error(&text.replace("q^3", "p^3"));
        assert!(unreadable.to_string().contains("line 5: `formula`: expected a variable"), "{unreadable}");
        let unnamed = error(&text.replace("id = \"side_car_spring\"\nk", "id = \"other\"\nk"));
        assert!(unnamed.to_string().contains("other.definition: id"), "{unnamed}");
    }

    #[test]
    fn verif_a_property_itself_is_refused_where_its_change_belongs() {
        for effect in CATALOGUE.iter().filter(|e| e.has_log_ratios()) {
            let d = effect.description();
            let given = d.parameters.iter().map(|p| format!("{} = {{ value = 8, unit = {:?} }}\n", p.name, p.unit));
            let text = format!("{HEAD}[[effect]]\nid = {:?}\n{}", d.id, given.collect::<String>());
            let error = SideCar::parse(&text, Path::new("effects.toml")).unwrap_err();
            let expected = format!("{}.{}.unit: expected \"ln(ratio)\"", d.id, d.parameters[0].name);
            assert!(error.to_string().contains(&expected), "{error}");
            assert!(error.hint().is_some_and(|hint| hint.contains("logarithm of the ratio")), "{error}");
        }
        let nonsense = format!(
            "{HEAD}[[effect]]\nid = \"max_contraction_velocity\"\nmax_contraction_velocity = {{ value = 8, unit = \
             \"m\" }}\n"
        );
        let error = SideCar::parse(&nonsense, Path::new("effects.toml")).unwrap_err();
        assert!(matches!(error, SideCarError::Unexpected { .. }), "{error}");
    }
}
