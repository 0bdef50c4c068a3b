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

use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::diagnosis::catalogue::{CATALOGUE, effect};
use crate::diagnosis::forward_model::Setting;
use crate::osim::error::nearest;

/// Schema of the file.
pub const SIDE_CAR_SCHEMA: &str = "carpus.effects/1";

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
}

impl SideCarError {
    /// What to do about it.
    pub fn hint(&self) -> Option<String> {
        match self {
            SideCarError::UnknownEffect { nearest: Some(nearest), .. } => Some(format!("did you mean \"{nearest}\"?")),
            SideCarError::UnknownEffect { .. } => Some("carpus effects lists them".to_owned()),
            _ => None,
        }
    }
}

impl SideCar {
    /// The file's text.
    pub fn to_toml(&self) -> String {
        let mut text =
            String::from("# Effects that no component of stock OpenSim has; read together with the model.\n");
        text.push_str(&format!("schema = {}\ncoordinate = {}\n", quoted(SIDE_CAR_SCHEMA), quoted(&self.coordinate)));
        for item in &self.effects {
            let description = item.effect.description();
            text.push_str(&format!("\n# {}: {}\n", description.name, description.equation));
            text.push_str(&format!("[[effect]]\nid = {}\n", quoted(description.id)));
            for (parameter, value) in description.parameters.iter().zip(&item.values) {
                let unit = quoted(parameter.unit);
                text.push_str(&format!("{} = {{ value = {value:?}, unit = {unit} }}\n", parameter.name));
            }
        }
        text
    }

    /// Reads a file.
    ///
    /// # Errors
    /// [`SideCarError`].
    pub fn read(file: &Path) -> Result<SideCar, SideCarError> {
        let text = std::fs::read_to_string(file)
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

/// A basic string of TOML: JSON's escapes are among TOML's.
fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string()
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
            return Err(self.unexpected("schema", quoted(SIDE_CAR_SCHEMA), table.get("schema")));
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

    fn effect(&self, table: &toml::Table, at: &str) -> Result<Setting, SideCarError> {
        let id = self.text(table, "id", &format!("{at}: "))?;
        let Some(effect) = effect(id) else {
            return Err(SideCarError::UnknownEffect {
                file: self.file.to_owned(),
                id: id.to_owned(),
                nearest: nearest(id, CATALOGUE.iter().map(|e| e.description().id)),
            });
        };
        let parameters = effect.description().parameters;
        let allowed: Vec<&str> = std::iter::once("id").chain(parameters.iter().map(|p| p.name)).collect();
        self.only(table, &allowed, id)?;
        let mut values = Vec::with_capacity(parameters.len());
        for parameter in parameters {
            let at = format!("{id}.{}", parameter.name);
            let given = table.get(parameter.name);
            let inner = given.and_then(toml::Value::as_table);
            let Some(inner) = inner else {
                let expected = format!("{{ value = …, unit = {} }}", quoted(parameter.unit));
                return Err(self.unexpected(&at, expected, given));
            };
            self.only(inner, &["value", "unit"], &at)?;
            if self.text(inner, "unit", &format!("{at}."))? != parameter.unit {
                return Err(self.unexpected(&format!("{at}.unit"), quoted(parameter.unit), inner.get("unit")));
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
