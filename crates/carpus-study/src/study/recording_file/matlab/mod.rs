//! Recordings in MATLAB's files: which variables belong together, what they are called, and when they were sampled.
//!
//! In: bytes of a `.mat` file of level 5. Out: tables. Vectors of one length that are fields of one struct, or
//! variables beside each other, are a table. A matrix is as many columns as it is narrow, with the names of a list of
//! as many texts beside it. Times are a variable of that name, or follow from a sampling rate or interval. A struct
//! that holds one signal (`name`, `values`, `interval`) is a column of a table with its neighbours.

mod element;

use element::Value;

use super::error::RecordingFileError;
use super::format::Format;
use super::recorded_table::RecordedTable;
use crate::study::dialect::is_time_name;
use crate::study::limits::MIN_SAMPLES;

/// Most tables of a file: a thousand trials.
const MOST_TABLES: usize = 1000;
/// Title of variables that are in no struct.
pub(super) const TOP: &str = "variables";

/// The tables of a file.
///
/// - `is_wanted`: which variables that are structs are read
///
/// # Errors
/// Bytes that are no such file; no table; too much.
pub fn tables(bytes: &[u8], is_wanted: &dyn Fn(&str) -> bool) -> Result<Vec<RecordedTable>, RecordingFileError> {
    let variables = element::variables(bytes, is_wanted)?;
    let named: Vec<(&str, &Value)> = variables.iter().map(|(name, value)| (name.as_str(), value)).collect();
    let mut tables = Vec::new();
    of_scope("", &Scope { named: &named, outer: None }, &mut tables)?;
    if tables.is_empty() {
        let found: Vec<String> = variables.iter().take(12).map(|(name, value)| described(name, value)).collect();
        let found = if found.is_empty() { "no variable".to_owned() } else { found.join(", ") };
        return Err(RecordingFileError::NoTable { format: Format::Matlab, rows: MIN_SAMPLES, found });
    }
    Ok(tables)
}

fn described(name: &str, value: &Value) -> String {
    match value {
        Value::Numbers { rows, values } => {
            format!("{name} ({rows} × {} numbers)", values.len().checked_div(*rows).unwrap_or(0))
        }
        Value::Text(_) => format!("{name} (text)"),
        Value::Cells(cells) => format!("{name} ({} cells)", cells.len()),
        Value::Structs { fields, .. } => format!("{name} (struct of {})", fields.join(", ")),
        Value::Other(what) => format!("{name} ({what})"),
    }
}

/// Values beside each other, and those around them.
struct Scope<'v> {
    named: &'v [(&'v str, &'v Value)],
    outer: Option<&'v Scope<'v>>,
}

/// A column of a table to be.
struct Signal {
    name: String,
    unit: String,
    samples: Vec<f64>,
    /// Samples per second that the signal itself states [Hz].
    rate: Option<f64>,
}

/// Adds the tables of a scope and of what is in it.
fn of_scope(path: &str, scope: &Scope<'_>, tables: &mut Vec<RecordedTable>) -> Result<(), RecordingFileError> {
    let mut signals: Vec<Signal> = Vec::new();
    let mut inner: Vec<(String, Vec<(&str, &Value)>)> = Vec::new();
    for (name, value) in scope.named {
        match value {
            Value::Numbers { rows, values } => signals.extend(scope.columns(name, *rows, values)),
            Value::Cells(cells) => {
                signals.extend(scope.cell_columns(name, cells));
                for (i, cell) in cells.iter().enumerate() {
                    inner.extend(structs(&format!("{}{{{}}}", joined(path, name), i + 1), cell));
                }
            }
            Value::Structs { .. } => inner.extend(structs(&joined(path, name), value)),
            Value::Text(_) | Value::Other(_) => {}
        }
    }
    // Structs of one signal each are columns here, where they stand beside each other.
    let mut left = Vec::new();
    for (path, fields) in inner {
        let own = path.rsplit('.').next().unwrap_or(&path).to_owned();
        match (Scope { named: &fields, outer: Some(scope) }).one_signal(&own) {
            Some(signal) => signals.push(signal),
            None => left.push((path, fields)),
        }
    }
    let found = grouped(path, signals, scope);
    if tables.len() + found.len() > MOST_TABLES {
        return Err(RecordingFileError::TooLarge { format: Format::Matlab, what: "tables", limit: MOST_TABLES });
    }
    tables.extend(found);
    for (path, fields) in left {
        of_scope(&path, &Scope { named: &fields, outer: Some(scope) }, tables)?;
    }
    Ok(())
}

/// The elements of a value that is of structs, with their paths.
fn structs<'v>(path: &str, value: &'v Value) -> Vec<(String, Vec<(&'v str, &'v Value)>)> {
    let Value::Structs { fields, elements } = value else { return Vec::new() };
    let of = |(i, values): (usize, &'v Vec<Value>)| {
        let path = if elements.len() > 1 { format!("{path}({})", i + 1) } else { path.to_owned() };
        (path, fields.iter().map(String::as_str).zip(values).collect())
    };
    elements.iter().enumerate().map(of).collect()
}

fn joined(path: &str, name: &str) -> String {
    if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") }
}

/// Signals of one length and one rate are a table.
fn grouped(path: &str, signals: Vec<Signal>, scope: &Scope<'_>) -> Vec<RecordedTable> {
    let mut groups: Vec<(usize, Option<f64>, Vec<Signal>)> = Vec::new();
    for signal in signals {
        let (length, rate) = (signal.samples.len(), signal.rate);
        match groups.iter_mut().find(|(n, r, _)| *n == length && *r == rate) {
            Some((_, _, group)) => group.push(signal),
            None => groups.push((length, rate, vec![signal])),
        }
    }
    // One column alone is a table only if its own struct says when it was sampled.
    let is_alone = groups.len() == 1;
    let title = if path.is_empty() { TOP } else { path };
    let mut tables = Vec::new();
    for (length, rate, group) in groups {
        let own = if is_alone { title.to_owned() } else { format!("{title}, {length} samples") };
        let mut table = RecordedTable::new(&own);
        let (times, others): (Vec<Signal>, Vec<Signal>) = group.into_iter().partition(|s| is_time_name(&s.name));
        if others.is_empty() {
            continue;
        }
        for signal in times.into_iter().chain(others) {
            table.push(&signal.name, &signal.unit, signal.samples);
        }
        let rate = rate.or_else(|| scope.rate(&table.names)).filter(|rate| rate.is_finite() && *rate > 0.0);
        tables.push(match rate.filter(|_| !table.has_time()) {
            Some(rate) => table.finished().with_rate(rate),
            None => table.finished(),
        });
    }
    tables
}

/// Words of a name: `EMG_fs`, `samplingRate`.
fn words(name: &str) -> Vec<String> {
    let mut words: Vec<String> = Vec::new();
    let mut before = ' ';
    for c in name.chars() {
        let begins = !before.is_alphanumeric() || (c.is_uppercase() && before.is_lowercase());
        if c.is_alphanumeric() {
            if begins || words.is_empty() {
                words.push(String::new());
            }
            words.last_mut().into_iter().for_each(|word| word.extend(c.to_lowercase()));
        }
        before = c;
    }
    words
}

/// Whether a name is that of a rate, or of an interval.
fn is_rate(name: &str) -> Option<bool> {
    let found = words(name);
    let whole = found.concat();
    let has = |names: &[&str]| found.iter().any(|word| names.contains(&word.as_str())) || names.contains(&&*whole);
    if has(&["isi", "dt", "interval", "sampleinterval", "sampinterval", "ts"]) {
        return Some(false);
    }
    // Cut-off frequencies, rates of stimuli and the like say nothing of samples.
    let others = ["cut", "filt", "notch", "high", "low", "band", "heart", "move", "stim", "step", "strok", "resp"];
    if found.iter().any(|word| others.iter().any(|other| word.starts_with(other))) {
        return None;
    }
    let rates = ["fs", "fsamp", "srate", "sr", "samplerate", "samplingrate", "rate", "frequency", "freq", "hz"];
    (has(&rates) || whole.ends_with("samplingfrequency") || whole.ends_with("samplefrequency")).then_some(true)
}

impl<'v> Scope<'v> {
    fn text(&self, name: &str) -> Option<&'v str> {
        let found = self.named.iter().find(|(known, _)| known.eq_ignore_ascii_case(name))?;
        match found.1 {
            Value::Text(lines) if lines.len() == 1 => Some(&lines[0]),
            _ => None,
        }
    }

    /// Lists of so many texts, with their names; those of the scope around where there are none.
    fn lists(&self, count: usize) -> Vec<(&'v str, Vec<String>)> {
        let list = |(name, value): &(&'v str, &'v Value)| {
            let texts: Vec<String> = match value {
                Value::Text(lines) => lines.clone(),
                Value::Cells(cells) => cells
                    .iter()
                    .map(|cell| match cell {
                        Value::Text(lines) => Some(lines.first().cloned().unwrap_or_default()),
                        _ => None,
                    })
                    .collect::<Option<_>>()?,
                _ => return None,
            };
            (texts.len() == count).then_some((*name, texts))
        };
        let own: Vec<(&str, Vec<String>)> = self.named.iter().filter_map(list).collect();
        if own.is_empty() { self.outer.map(|outer| outer.lists(count)).unwrap_or_default() } else { own }
    }

    /// Names and units of so many columns of a variable.
    fn labels(&self, name: &str, count: usize) -> Vec<(String, String)> {
        let is_of_units = |list: &&(&str, Vec<String>)| list.0.to_lowercase().contains("unit");
        let lists = self.lists(count);
        let kin = |list: &&(&str, Vec<String>)| {
            let own = words(name);
            words(list.0).iter().any(|word| own.contains(word))
        };
        let of = |units: bool| {
            let these: Vec<&(&str, Vec<String>)> = lists.iter().filter(|l| is_of_units(l) == units).collect();
            these.iter().find(|list| kin(list)).or(these.first()).map(|list| list.1.clone())
        };
        let numbered = |i: usize| if count == 1 { name.to_owned() } else { format!("{name}_{}", i + 1) };
        let labels = of(false).filter(|_| count > 1).unwrap_or_default();
        let units = of(true).unwrap_or_default();
        let one = |i: usize| {
            let label = labels.get(i).filter(|label| !label.is_empty()).cloned();
            let stated = || self.text(&format!("{name}_unit")).or_else(|| self.text(&format!("{name}_units")));
            let of_all = || stated().or_else(|| self.text("units").or_else(|| self.text("unit")).filter(|_| count > 1));
            let unit = units.get(i).cloned().or_else(|| of_all().map(str::to_owned));
            (label.unwrap_or_else(|| numbered(i)), unit.unwrap_or_default())
        };
        (0..count).map(one).collect()
    }

    /// The columns of a variable: samples are along its longer side.
    fn columns(&self, name: &str, rows: usize, values: &[f64]) -> Vec<Signal> {
        let columns = values.len().checked_div(rows).unwrap_or(0);
        let (length, count) = (rows.max(columns), rows.min(columns));
        if length < MIN_SAMPLES || count == 0 {
            return Vec::new();
        }
        let samples = |i: usize| -> Vec<f64> {
            match rows >= columns {
                true => values[i * rows..(i + 1) * rows].to_vec(),
                false => values.iter().skip(i).step_by(rows).copied().collect(),
            }
        };
        // Times of every channel, which are the same.
        if is_time_name(name) && count > 1 && (1..count).all(|i| samples(i) == samples(0)) {
            let unit = self.text(&format!("{name}_unit")).unwrap_or_default().to_owned();
            return vec![Signal { name: name.to_owned(), unit, samples: samples(0), rate: None }];
        }
        let labels = self.labels(name, count).into_iter().enumerate();
        labels.map(|(i, (name, unit))| Signal { name, unit, samples: samples(i), rate: None }).collect()
    }

    /// The columns of cells that hold a vector each.
    fn cell_columns(&self, name: &str, cells: &[Value]) -> Vec<Signal> {
        let vector = |cell: &Value| match cell {
            Value::Numbers { rows, values } if *rows == 1 || *rows == values.len() => Some(values.clone()),
            _ => None,
        };
        if let [Value::Numbers { rows, values }] = cells {
            return self.columns(name, *rows, values);
        }
        let Some(vectors) = cells.iter().map(vector).collect::<Option<Vec<_>>>() else { return Vec::new() };
        let long = vectors.iter().filter(|samples| samples.len() >= MIN_SAMPLES).count();
        if long < vectors.len() {
            return Vec::new();
        }
        if is_time_name(name) && vectors.len() > 1 && vectors.iter().all(|samples| *samples == vectors[0]) {
            let samples = vectors.into_iter().next().unwrap_or_default();
            return vec![Signal { name: name.to_owned(), unit: String::new(), samples, rate: None }];
        }
        let labels = self.labels(name, vectors.len());
        let columns = labels.into_iter().zip(vectors);
        columns.map(|((name, unit), samples)| Signal { name, unit, samples, rate: None }).collect()
    }

    /// The one signal of a struct that says its name, or when it was sampled: `title`, `values`, `interval`, `units`.
    fn one_signal(&self, own: &str) -> Option<Signal> {
        let vectors = self.named.iter().filter_map(|(name, value)| match value {
            Value::Numbers { rows, values } if values.len() >= MIN_SAMPLES => {
                (*rows == 1 || *rows == values.len()).then_some((*name, values))
            }
            _ => None,
        });
        let vectors: Vec<(&str, &Vec<f64>)> = vectors.filter(|(name, _)| !is_time_name(name)).collect();
        let [(field, samples)] = vectors[..] else { return None };
        let is_of_samples = ["data", "values", "samples", "signal", "wave", "y"].contains(&&*field.to_lowercase());
        let has_times = self.named.iter().any(|(name, value)| {
            is_time_name(name) && matches!(value, Value::Numbers { values, .. } if values.len() == samples.len())
        });
        let has_structs = self.named.iter().any(|(_, value)| matches!(value, Value::Structs { .. }));
        if !is_of_samples || has_times || has_structs {
            return None;
        }
        let name = ["name", "title", "label", "channel"].into_iter().find_map(|key| self.text(key));
        let unit = self.text("units").or_else(|| self.text("unit")).unwrap_or_default();
        let rate = Scope { named: self.named, outer: None }.rate(&[]);
        let name = name.filter(|name| !name.is_empty()).unwrap_or(own).to_owned();
        Some(Signal { name, unit: unit.to_owned(), samples: samples.clone(), rate })
    }

    /// Samples per second that a variable states, or that an interval leads to [Hz]; of several, that whose name has a
    /// word of a column.
    fn rate(&self, columns: &[String]) -> Option<f64> {
        let stated = self.named.iter().filter_map(|(name, value)| {
            let Value::Numbers { values, .. } = value else { return None };
            let first = *values.first()?;
            let same = values.len() < MIN_SAMPLES.max(columns.len() + 1) && values.iter().all(|v| *v == first);
            let is_rate = is_rate(name).filter(|_| same && first > 0.0)?;
            let in_ms = |text: &str| text.to_lowercase().starts_with("ms") || text.to_lowercase().starts_with("milli");
            let unit = self.text(&format!("{name}_units")).or_else(|| self.text(&format!("{name}_unit")));
            let second = if unit.is_some_and(in_ms) { 1e3 } else { 1.0 };
            Some((*name, if is_rate { first } else { second / first }))
        });
        let stated: Vec<(&str, f64)> = stated.collect();
        let of_columns: Vec<String> = columns.iter().flat_map(|name| words(name)).collect();
        let kin = stated.iter().find(|(name, _)| words(name).iter().any(|word| of_columns.contains(word)));
        let only = || stated.first().filter(|first| stated.iter().all(|(_, rate)| *rate == first.1));
        let own = kin.or_else(only).map(|(_, rate)| *rate);
        own.or_else(|| self.outer.filter(|_| stated.is_empty()).and_then(|outer| outer.rate(columns)))
    }
}
