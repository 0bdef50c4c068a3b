//! Reading `.sto` and `.mot` files of all versions.

use std::path::{Path, PathBuf};

use super::error::{StorageError, StorageProblem};
use super::table::Storage;
use super::trc::Markers;
use super::words::{extension, number};
use carpus_numerics::printable;

/// Keys of SIMM's motion files that mean nothing here (`simmReservedKeys`).
const SIMM_KEYS: [&str; 20] = [
    "name",
    "datacolumns",
    "datarows",
    "otherdata",
    "range",
    "bodycolor",
    "wrap",
    "enforce_loops",
    "enforce_constraints",
    "calc_derivatives",
    "show_cursor",
    "event",
    "color",
    "event_color",
    "event_star",
    "event_plane",
    "cursor",
    "sliding_time_scale",
    "time",
    "#",
];

/// What a header says.
#[derive(Default)]
struct Header {
    name: String,
    version: u32,
    rows: Option<usize>,
    columns: Option<usize>,
    in_degrees: Option<bool>,
    vectors: bool,
    range: Option<[f64; 2]>,
    description: String,
    /// What was read otherwise than it stands there.
    warnings: Vec<String>,
}

impl Storage {
    /// Reads a `.sto` or `.mot` file; a `.trc` file as three columns per marker, `_1`, `_2`, `_3`, in metres.
    ///
    /// # Errors
    /// [`StorageError`] with the line.
    pub fn read(path: impl AsRef<Path>) -> Result<Storage, StorageError> {
        let path = path.as_ref();
        if extension(path) == "trc" {
            return Ok(Markers::read(path)?.into_storage());
        }
        let fail = |source| StorageError { file: path.to_owned(), line: 0, problem: StorageProblem::Read(source) };
        Storage::parse(&carpus_numerics::regular_file::read(path).map_err(fail)?, path)
    }

    /// Reads the text of a `.sto` or `.mot` file; `file` is its name: in motion files without a version, rotations are
    /// in degrees.
    ///
    /// # Errors
    /// [`StorageError`] with the line.
    pub fn parse(bytes: &[u8], file: &Path) -> Result<Storage, StorageError> {
        let text = String::from_utf8_lossy(bytes);
        let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
        // \r\n, \n and \r all end a line.
        let text = text.replace("\r\n", "\n").replace('\r', "\n");
        let mut lines = text.split('\n').enumerate().map(|(i, line)| (i + 1, line));
        let at = |line: usize, problem| StorageError { file: file.to_owned(), line, problem };
        let mut header = header(&mut lines, file)?;
        let Some((label_line, labels)) = lines.find(|(_, line)| !line.trim().is_empty()) else {
            return Err(at(0, StorageProblem::NoLabels));
        };
        let all: Vec<String> = labels.split_ascii_whitespace().map(str::to_owned).collect();
        let mut warnings = std::mem::take(&mut header.warnings);
        if let Some(said) = header.columns.filter(|said| *said != all.len()) {
            let text =
                format!("the header says {said} columns, there are labels of {}; the labels are believed", all.len());
            warnings.push(text);
        }
        let time = all.iter().position(|label| label == "time");
        let mut time = match (time, header.range) {
            (Some(time), _) => Some(time),
            (None, Some(_)) => None,
            (None, None) => {
                let found = all.iter().take(6).cloned().collect();
                return Err(at(label_line, StorageProblem::NoTime { found }));
            }
        };
        // OpenSim takes the first column for time, whatever its label, if one is called so.
        time = time.map(|_| 0);
        let (mut rows, mut row_lines): (Vec<Vec<f64>>, Vec<usize>) = (Vec::new(), Vec::new());
        let mut numbers = Vec::new();
        let width = if header.vectors { 3 * (all.len() - 1) + 1 } else { all.len() };
        let mut last_line = label_line;
        // A row may go on in the next line; if that has too many values, the line before had too few.
        let mut short: Option<(usize, usize)> = None;
        // In newer versions OpenSim reads to the end whatever the header says.
        let bound = header.rows.filter(|_| header.version <= 1);
        for (line, text) in lines {
            if bound.is_some_and(|said| rows.len() == said) {
                if !text.trim().is_empty() {
                    warnings.push(format!("line {line} and what follows is beyond the rows that the header says"));
                    break;
                }
                continue;
            }
            let separators = |c: char| c.is_ascii_whitespace() || (header.vectors && c == ',');
            for word in text.split(separators).filter(|word| !word.is_empty()) {
                let Some(value) = number(word) else {
                    let column = if header.vectors { numbers.len().div_ceil(3) } else { numbers.len() };
                    let column = all.get(column).cloned().unwrap_or_default();
                    return Err(at(line, StorageProblem::NotANumber { column, found: word.to_owned() }));
                };
                numbers.push(value);
                if numbers.len() > width {
                    let here = || (line, text.split(separators).filter(|word| !word.is_empty()).count());
                    let (line, found) = short.unwrap_or_else(here);
                    return Err(at(line, StorageProblem::RowLength { expected: width, found }));
                }
            }
            last_line = line;
            if numbers.len() == width {
                rows.push(std::mem::take(&mut numbers));
                row_lines.push(line);
                short = None;
            } else if !numbers.is_empty() && !text.trim().is_empty() && header.version > 1 {
                return Err(at(line, StorageProblem::RowLength { expected: width, found: numbers.len() }));
            } else if !numbers.is_empty() {
                short = short.or(Some((line, numbers.len())));
            }
        }
        if !numbers.is_empty() {
            return Err(at(last_line, StorageProblem::RowLength { expected: width, found: numbers.len() }));
        }
        if rows.is_empty() {
            return Err(at(label_line, StorageProblem::NoRows));
        }
        if let Some(said) = header.rows.filter(|said| *said > rows.len()) {
            let found = rows.len();
            warnings.push(format!("the header says {said} rows, there are {found}: the file may be cut off"));
        } else if let Some(said) = header.rows.filter(|said| bound.is_none() && *said < rows.len()) {
            warnings.push(format!("the header says {said} rows, there are {}; all are read", rows.len()));
        }
        let mut labels = all;
        let times: Vec<f64> = match time {
            Some(time) => {
                labels.remove(time);
                rows.iter_mut().map(|row| row.remove(time)).collect()
            }
            None => {
                let [start, end] = header.range.unwrap_or_default();
                let step = (end - start) / (rows.len().max(2) - 1) as f64;
                (0..rows.len()).map(|i| i as f64 * step).collect()
            }
        };
        if header.vectors {
            labels = labels.iter().flat_map(|label| (1..=3).map(move |k| format!("{label}_{k}"))).collect();
        }
        let (times, rows, lines, repeated) = without_repeated_times(times, rows, row_lines);
        if repeated > 0 {
            warnings.push(format!("{repeated} rows have the time of the row before: of such rows the last is taken"));
        }
        if let Some(i) = (1..times.len()).find(|&i| !(times[i] >= times[i - 1])) {
            let problem = StorageProblem::TimeOrder { previous: times[i - 1], next: times[i] };
            return Err(at(label_line + i + 1, problem));
        }
        warnings.extend(doubtful_steps(&times));
        let is_motion = extension(file) == "mot";
        let in_degrees = header.in_degrees.unwrap_or(false) || (header.version < 1 && is_motion);
        let (name, description) = (header.name, header.description);
        Ok(Storage { name, in_degrees, description, labels, time: times, rows, lines, warnings })
    }
}

/// What is said of times that are in another unit than seconds, by their median distance.
fn doubtful_steps(times: &[f64]) -> Option<String> {
    /// Least and largest distance of rows of a motion or of forces [s].
    const PLAUSIBLE: [f64; 2] = [1e-6, 1.0];
    /// Fewer rows are poses rather than a motion.
    const FEWEST: usize = 4;
    let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    if times.len() < FEWEST {
        return None;
    }
    let middle = steps.len() / 2;
    let (_, median, _) = steps.select_nth_unstable_by(middle, f64::total_cmp);
    let median = *median;
    if (PLAUSIBLE[0]..=PLAUSIBLE[1]).contains(&median) {
        return None;
    }
    let is_steady = |unit: &f64| (1e-5..=0.1).contains(&(median * unit));
    let guess = match [1e-3, 1e-6].iter().position(is_steady) {
        Some(0) => ": are these milliseconds?",
        Some(_) => ": are these microseconds?",
        None => ": times are in seconds",
    };
    let four_digits = format!("{median:.3e}").parse().unwrap_or(median);
    Some(format!("the median step of `time` is {} s{guess}", printable::number(four_digits)))
}

/// Times, rows and their lines without those that another row of the same time follows, as OpenSim's `Storage::append`;
/// also the number of these.
fn without_repeated_times(
    times: Vec<f64>,
    rows: Vec<Vec<f64>>,
    lines: Vec<usize>,
) -> (Vec<f64>, Vec<Vec<f64>>, Vec<usize>, usize) {
    let all = times.len();
    let keep: Vec<bool> = (0..all).map(|i| times.get(i + 1) != Some(&times[i])).collect();
    let kept = |i: &usize| keep[*i];
    let rows: Vec<Vec<f64>> = rows.into_iter().enumerate().filter(|(i, _)| kept(i)).map(|(_, row)| row).collect();
    let lines: Vec<usize> = lines.into_iter().enumerate().filter(|(i, _)| kept(i)).map(|(_, line)| line).collect();
    let times: Vec<f64> = times.into_iter().enumerate().filter(|(i, _)| kept(i)).map(|(_, time)| time).collect();
    let repeated = all - times.len();
    (times, rows, lines, repeated)
}

/// A count in a header: the digits that lead, as OpenSim reads it; and again, if more than digits stood there.
fn count(text: &str) -> Option<(usize, Option<usize>)> {
    let word = text.split_ascii_whitespace().next()?;
    if let Ok(number) = word.parse() {
        return Some((number, None));
    }
    let digits = word.find(|c: char| !c.is_ascii_digit())?;
    let number = word[..digits].parse().ok()?;
    Some((number, Some(number)))
}

fn header<'a>(lines: &mut impl Iterator<Item = (usize, &'a str)>, file: &Path) -> Result<Header, StorageError> {
    let mut header = Header::default();
    let mut first = true;
    let at = |line: usize, problem| StorageError { file: PathBuf::from(file), line, problem };
    for (number_of_line, line) in lines {
        let line = line.trim();
        if line.is_empty() {
            continue;
        }
        let end = line.find([' ', '\t', '=']).unwrap_or(line.len());
        let (key, rest) = (&line[..end], line[end..].trim_start_matches([' ', '\t', '=']));
        let mut count = || {
            let wrong = || StorageProblem::Count { key: key.to_owned(), found: rest.to_owned() };
            let (number, read) = count(rest).ok_or_else(|| at(number_of_line, wrong()))?;
            if let Some(taken) = read {
                let warning = format!("line {number_of_line}: {key} is \"{rest}\"; {taken} is taken, as in OpenSim");
                header.warnings.push(warning);
            }
            Ok(Some(number))
        };
        match key {
            "name" => header.name = rest.to_owned(),
            "nr" | "nRows" | "datarows" => header.rows = count()?,
            "nc" | "nColumns" | "datacolumns" => header.columns = count()?,
            "range" => {
                let numbers: Vec<f64> = rest.split_ascii_whitespace().filter_map(number).collect();
                header.range = numbers.get(..2).map(|r| [r[0], r[1]]);
            }
            "version" => header.version = rest.parse().unwrap_or(0),
            "inDegrees" => header.in_degrees = Some(matches!(rest.to_lowercase().as_str(), "yes" | "y")),
            "Angles" if header.version == 0 => {
                if line == "Angles are in degrees." {
                    header.in_degrees = Some(true);
                } else if line == "Angles are in radians." {
                    header.in_degrees = Some(false);
                }
            }
            "DataType" => match rest {
                "double" => {}
                "Vec3" => header.vectors = true,
                found => return Err(at(number_of_line, StorageProblem::DataType { found: found.to_owned() })),
            },
            "endheader" => return Ok(header),
            key if SIMM_KEYS.contains(&key) => {}
            _ if first => header.name = line.to_owned(),
            _ => {}
        }
        first = false;
    }
    Err(at(0, StorageProblem::NoEndOfHeader))
}
