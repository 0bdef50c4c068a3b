//! Marker trajectories, `.trc`.

use std::fmt::Write;
use std::path::Path;

use nalgebra::Vector3;

use super::error::{StorageError, StorageProblem};
use super::table::Storage;
use super::words::{metres, number};

/// Where markers are over time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Markers {
    /// Names in the order of the file.
    pub names: Vec<String>,
    /// Times [s].
    pub time: Vec<f64>,
    /// One row per time, one place per marker [m]; NaN where a marker is not seen.
    pub rows: Vec<Vec<Vector3<f64>>>,
    /// Frames per second [Hz].
    pub data_rate: f64,
    /// What was odd about the file, to be told to the user.
    pub warnings: Vec<String>,
}

impl Markers {
    /// Reads the text of a `.trc` file; `file` is its name in messages. Empty cells are markers that are not seen.
    ///
    /// # Errors
    /// [`StorageError`] with the line.
    pub fn parse(bytes: &[u8], file: &Path) -> Result<Markers, StorageError> {
        let text = String::from_utf8_lossy(bytes);
        let text = text.strip_prefix('\u{feff}').unwrap_or(&text).replace("\r\n", "\n").replace('\r', "\n");
        let lines: Vec<&str> = text.split('\n').collect();
        let at = |line: usize, problem| StorageError { file: file.to_owned(), line, problem };
        let missing = |line: usize, what: &str| at(line, StorageProblem::TrcHeader { what: what.to_owned() });
        let line = |i: usize| lines.get(i).copied().ok_or_else(|| missing(i + 1, "the file ends before"));
        if !line(0)?.trim_start().starts_with("PathFileType") {
            return Err(missing(1, "the first line does not begin with PathFileType"));
        }
        let keys: Vec<&str> = line(1)?.split_ascii_whitespace().collect();
        let values: Vec<&str> = line(2)?.split_ascii_whitespace().collect();
        let value = |key: &str| keys.iter().position(|k| *k == key).and_then(|i| values.get(i)).copied();
        let units = value("Units").ok_or_else(|| missing(2, "no Units"))?;
        let unit = metres(units).ok_or_else(|| at(3, StorageProblem::Units { found: units.to_owned() }))?;
        let data_rate = value("DataRate").and_then(number).unwrap_or(f64::NAN);
        let names: Vec<String> =
            line(3)?.split('\t').skip(2).map(str::trim).filter(|n| !n.is_empty()).map(str::to_owned).collect();
        if names.is_empty() {
            return Err(missing(4, "no markers behind Frame# and Time"));
        }
        if let Some(label) = (1..names.len()).map(|i| &names[i]).enumerate().find(|(i, n)| names[..=*i].contains(n)) {
            return Err(at(4, StorageProblem::SameLabel { label: label.1.clone() }));
        }
        let said = value("NumMarkers").and_then(|n| n.parse::<usize>().ok());
        if said.is_some_and(|said| said != names.len()) {
            let what = format!("NumMarkers is {}, there are {} names", said.unwrap_or(0), names.len());
            return Err(missing(4, &what));
        }
        line(4)?;
        let mut markers = Markers { names, data_rate, ..Markers::default() };
        for (i, row) in lines.iter().enumerate().skip(5).filter(|(_, row)| !row.trim().is_empty()) {
            markers.read_row(row, unit).map_err(|problem| at(i + 1, problem))?;
        }
        if markers.time.is_empty() {
            return Err(at(6, StorageProblem::NoRows));
        }
        Ok(markers)
    }

    fn read_row(&mut self, row: &str, unit: f64) -> Result<(), StorageProblem> {
        // A cell may be empty: only the tab separates. Without empty cells any white space does.
        let mut cells: Vec<&str> = row.split('\t').map(str::trim).collect();
        while cells.len() > 2 + 3 * self.names.len() && cells.last().is_some_and(|c| c.is_empty()) {
            cells.pop();
        }
        if cells.len() < 2 {
            cells = row.split_ascii_whitespace().collect();
        }
        if cells.len() > 2 + 3 * self.names.len() || cells.len() < 2 {
            return Err(StorageProblem::RowLength { expected: 2 + 3 * self.names.len(), found: cells.len() });
        }
        let read = |column: &str, cell: &str| {
            if cell.is_empty() {
                return Ok(f64::NAN);
            }
            let wrong = || StorageProblem::NotANumber { column: column.to_owned(), found: cell.to_owned() };
            number(cell).ok_or_else(wrong)
        };
        let time = read("Time", cells[1])?;
        if let Some(&previous) = self.time.last().filter(|previous| !(time > **previous)) {
            return Err(StorageProblem::TimeOrder { previous, next: time });
        }
        let mut places = Vec::with_capacity(self.names.len());
        for (i, name) in self.names.iter().enumerate() {
            let mut place = Vector3::from_element(f64::NAN);
            for k in 0..3 {
                place[k] = unit * read(name, cells.get(2 + 3 * i + k).copied().unwrap_or_default())?;
            }
            places.push(place);
        }
        self.time.push(time);
        self.rows.push(places);
        Ok(())
    }

    /// Row whose time is nearest.
    pub fn nearest(&self, time: f64) -> usize {
        let after = self.time.partition_point(|t| *t < time).min(self.time.len().saturating_sub(1));
        let before = after.saturating_sub(1);
        if (self.time[after] - time).abs() < (time - self.time[before]).abs() { after } else { before }
    }

    /// Three columns per marker [m].
    pub fn into_storage(self) -> Storage {
        let labels = self.names.iter().flat_map(|name| (1..=3).map(move |k| format!("{name}_{k}"))).collect();
        let rows = self.rows.iter().map(|row| row.iter().flat_map(|p| [p.x, p.y, p.z]).collect()).collect();
        Storage { labels, time: self.time, rows, ..Storage::default() }
    }

    pub(super) fn from_storage(storage: &Storage) -> Markers {
        let stem = |label: &String| label.rsplit_once('_').map_or(label.clone(), |(stem, _)| stem.to_owned());
        let names = storage.labels.chunks_exact(3).map(|three| stem(&three[0])).collect();
        let places = |row: &Vec<f64>| row.chunks_exact(3).map(|p| Vector3::new(p[0], p[1], p[2])).collect();
        let rows = storage.rows.iter().map(places).collect();
        Markers { names, time: storage.time.clone(), rows, data_rate: f64::NAN, warnings: storage.warnings.clone() }
    }

    /// The text of a `.trc` file in metres.
    pub fn text(&self, name: &str) -> String {
        let (rate, n, frames) = (self.data_rate, self.names.len(), self.time.len());
        let mut text = format!("PathFileType\t4\t(X/Y/Z)\t{name}\n");
        text.push_str(
            "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n",
        );
        let _ = writeln!(text, "{rate}\t{rate}\t{frames}\t{n}\tm\t{rate}\t1\t{frames}");
        text.push_str("Frame#\tTime");
        self.names.iter().for_each(|name| {
            let _ = write!(text, "\t{name}\t\t");
        });
        text.push_str("\n\t");
        (1..=n).for_each(|i| {
            let _ = write!(text, "\tX{i}\tY{i}\tZ{i}");
        });
        text.push_str("\n\n");
        for (i, (time, row)) in self.time.iter().zip(&self.rows).enumerate() {
            let _ = write!(text, "{}\t{time}", i + 1);
            for place in row {
                for value in place.iter() {
                    let _ = if value.is_nan() { write!(text, "\t") } else { write!(text, "\t{value}") };
                }
            }
            text.push('\n');
        }
        text
    }
}
