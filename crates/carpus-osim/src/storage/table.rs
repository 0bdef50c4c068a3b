//! A table: numbers over time, in named columns.

/// Numbers over time, in named columns.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Storage {
    /// Name: the first line of the file.
    pub name: String,
    /// What the header says about rotations.
    pub in_degrees: bool,
    /// Text between the header and `endheader`, as results of analyses have it; empty, or ending in a line break.
    pub description: String,
    /// Labels of the columns, time not among them.
    pub labels: Vec<String>,
    /// Times [s].
    pub time: Vec<f64>,
    /// One row per time, one value per label.
    pub rows: Vec<Vec<f64>>,
    /// Line of every row in the file, counted from 1; empty where rows are not those of a file.
    pub lines: Vec<usize>,
    /// What was odd about the file, to be told to the user.
    pub warnings: Vec<String>,
}

impl Storage {
    /// An empty storage.
    pub fn new(name: &str, labels: Vec<String>) -> Storage {
        Storage { name: name.to_owned(), labels, ..Storage::default() }
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.time.is_empty()
    }

    /// Adds a row.
    pub fn push(&mut self, time: f64, row: Vec<f64>) {
        debug_assert_eq!(row.len(), self.labels.len());
        self.time.push(time);
        self.rows.push(row);
    }

    /// The values of a column.
    pub fn column(&self, index: usize) -> Vec<f64> {
        self.rows.iter().map(|row| row[index]).collect()
    }

    /// The column with this label.
    pub fn find(&self, label: &str) -> Option<usize> {
        self.labels.iter().position(|l| l == label)
    }

    /// The column of a state variable, as `Storage::getStateIndex` looks for it: its path; or, in files of older
    /// versions, `<coordinate>`, `<coordinate>_u`, `<muscle>.activation`, `<muscle>.fiber_length`; or a path that ends
    /// with the same names.
    ///
    /// - `path`: e.g. `/jointset/elbow/elbow_flexion/value` or `/forceset/BIClong/activation`
    pub fn find_state(&self, path: &str) -> Option<usize> {
        if let Some(found) = self.find(path) {
            return Some(found);
        }
        let parts: Vec<&str> = path.split('/').collect();
        let [.., owner, variable] = parts.as_slice() else { return None };
        let old = match *variable {
            "value" => owner.to_string(),
            "speed" => format!("{owner}_u"),
            _ => format!("{owner}.{variable}"),
        };
        let joint = parts.len().checked_sub(3).map(|i| format!("{}/{owner}/{variable}", parts[i]));
        let short = format!("{owner}/{variable}");
        self.find(&old)
            .or_else(|| joint.as_deref().and_then(|label| self.find(label)))
            .or_else(|| self.find(&short))
            .or_else(|| self.labels.iter().position(|l| l.ends_with(&format!("/{short}"))))
    }

    /// The first value that is no finite number among some columns: its row and column.
    pub fn first_not_finite(&self, columns: &[usize]) -> Option<(usize, usize)> {
        let in_row = |row: &Vec<f64>| columns.iter().copied().find(|column| !row[*column].is_finite());
        self.rows.iter().enumerate().find_map(|(i, row)| Some((i, in_row(row)?)))
    }

    /// Row at or before a time; the first row for earlier times (`Storage::findIndex`).
    pub fn index_at(&self, time: f64) -> usize {
        self.time.partition_point(|t| *t <= time).saturating_sub(1)
    }

    /// Values at a time, linear between rows and beyond the ends (`Storage::getDataAtTime`).
    pub fn at(&self, time: f64) -> Vec<f64> {
        let Some(last) = self.len().checked_sub(1) else { return Vec::new() };
        let first = self.index_at(time).min(last.saturating_sub(1));
        let next = (first + 1).min(last);
        let span = self.time[next] - self.time[first];
        let share = if span < f64::EPSILON { 0.0 } else { (time - self.time[first]) / span };
        let between = |(a, b): (&f64, &f64)| if share == 0.0 { *a } else { a + share * (b - a) };
        self.rows[first].iter().zip(&self.rows[next]).map(between).collect()
    }

    /// The three columns of a vector whose labels begin with `identifier`, in their order
    /// (`Storage::getDataForIdentifier`).
    pub fn find_vector(&self, identifier: &str) -> Vec<usize> {
        (0..self.labels.len()).filter(|&i| self.labels[i].starts_with(identifier)).collect()
    }
}
