//! Rows of the validation table: how differences from the reference program are gathered, judged and written down.
//!
//! Every live comparison with OpenSim ends in rows of one format. Where `CARPUS_VALIDATION_DIR` names a folder, a test
//! writes its rows there as `SUBJECT.json`; `fixtures/scripts/validate.py` sets the variable, runs the tests and makes
//! the table of the book from what they wrote.

mod postures;

use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Outliers that a row lists one by one; the others are only counted.
const LISTED_OUTLIERS: usize = 50;

/// By what a row is judged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Judge {
    /// The 99th percentile of the differences.
    Q99,
    /// The largest difference.
    Max,
}

/// One comparison beyond the tolerance.
#[derive(Clone, Debug, Serialize)]
pub struct Outlier {
    /// Where: muscle, coordinate, pose, time.
    pub case: String,
    /// Difference; `None` where one of the two is not a number.
    pub difference: Option<f64>,
    /// Why, where it is known.
    pub explanation: Option<String>,
}

/// One line of the validation table.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Part of the program: reading, functions, kinematics, paths, muscles, passive forces, simulation, written model;
    /// `classes` for rows of one class of OpenSim's each.
    pub component: String,
    /// The model, or what stands in its place.
    pub model: String,
    /// What was compared.
    pub quantity: String,
    /// Its unit, or the scale that it is divided by.
    pub unit: String,
    /// Number of comparisons.
    pub count: usize,
    /// Median difference.
    pub median: Option<f64>,
    /// 99th percentile.
    pub q99: Option<f64>,
    /// Largest difference among numbers.
    pub max: Option<f64>,
    /// Comparisons where one of the two programs gives no number; beyond every tolerance.
    pub n_not_a_number: usize,
    /// The largest accepted difference.
    pub tolerance: f64,
    /// What must be within the tolerance.
    pub judged_by: Judge,
    /// Whether it is.
    pub passed: bool,
    /// The largest difference's place.
    pub worst_case: String,
    /// Number of differences beyond the tolerance.
    pub n_outliers: usize,
    /// The first of them, largest first.
    pub outliers: Vec<Outlier>,
    /// What else must be known to read the row.
    pub remark: Option<String>,
}

/// Differences of one quantity.
#[derive(Default)]
pub struct Differences {
    pub quantity: String,
    pub unit: &'static str,
    /// Differences beyond this are kept with their case.
    listed_above: Option<f64>,
    values: Vec<f64>,
    worst: Option<(f64, String)>,
    n_not_a_number: usize,
    outliers: Vec<(f64, String, Option<String>)>,
    remark: Option<String>,
}

impl Differences {
    pub fn new(quantity: impl Into<String>, unit: &'static str) -> Differences {
        Differences { quantity: quantity.into(), unit, ..Differences::default() }
    }

    /// Keeps every case beyond `tolerance`.
    pub fn listing_above(quantity: impl Into<String>, unit: &'static str, tolerance: f64) -> Differences {
        Differences { listed_above: Some(tolerance), ..Differences::new(quantity, unit) }
    }

    /// `case` names the place, should it be the worst or an outlier. NaN counts as infinitely wrong.
    pub fn push(&mut self, difference: f64, case: impl FnOnce() -> String) {
        self.push_explained(difference, case, None);
    }

    /// As [`Differences::push`], with the reason why this case may differ.
    pub fn push_explained(&mut self, difference: f64, case: impl FnOnce() -> String, explanation: Option<&str>) {
        let difference = if difference.is_nan() { f64::INFINITY } else { difference.abs() };
        self.values.push(difference);
        self.n_not_a_number += usize::from(difference.is_infinite());
        let worst = difference.is_finite() && self.worst.as_ref().is_none_or(|(worst, _)| difference > *worst);
        let outlier = self.listed_above.is_some_and(|tolerance| difference > tolerance);
        if worst || outlier {
            let case = case();
            if outlier {
                self.outliers.push((difference, case.clone(), explanation.map(str::to_owned)));
            }
            if worst {
                self.worst = Some((difference, case));
            }
        }
    }

    /// Adds what must be known to read the numbers.
    pub fn remark(&mut self, remark: impl Into<String>) {
        self.remark = Some(remark.into());
    }

    pub fn count(&self) -> usize {
        self.values.len()
    }

    /// Infinite where one of the two is not a number.
    pub fn max(&self) -> f64 {
        if self.n_not_a_number > 0 {
            return f64::INFINITY;
        }
        self.worst.as_ref().map_or(0.0, |(worst, _)| *worst)
    }

    /// The line of the table; prints it, too.
    pub fn row(&self, component: &str, model: &str, tolerance: f64, judged_by: Judge) -> Row {
        let mut sorted = self.values.clone();
        sorted.sort_by(f64::total_cmp);
        let quantile = |p: f64| {
            let rank = ((p * sorted.len() as f64).ceil() as usize).clamp(1, sorted.len().max(1));
            sorted.get(rank - 1).copied()
        };
        let q99 = quantile(0.99);
        let judged = if judged_by == Judge::Q99 { q99.unwrap_or(f64::INFINITY) } else { self.max() };
        let mut outliers = self.outliers.clone();
        outliers.sort_by(|a, b| b.0.total_cmp(&a.0));
        let finite = |x: f64| x.is_finite().then_some(x);
        let row = Row {
            component: component.into(),
            model: model.into(),
            quantity: self.quantity.clone(),
            unit: self.unit.into(),
            count: sorted.len(),
            median: quantile(0.5).and_then(finite),
            q99: q99.and_then(finite),
            max: self.worst.as_ref().map(|(worst, _)| *worst),
            n_not_a_number: self.n_not_a_number,
            tolerance,
            judged_by,
            passed: !sorted.is_empty() && judged <= tolerance,
            worst_case: self.worst.as_ref().map_or(String::new(), |(_, case)| case.clone()),
            n_outliers: sorted.iter().filter(|&&difference| difference > tolerance).count(),
            outliers: outliers
                .into_iter()
                .take(LISTED_OUTLIERS)
                .map(|(difference, case, explanation)| Outlier { case, difference: finite(difference), explanation })
                .collect(),
            remark: self.remark.clone(),
        };
        println!("{row}");
        row
    }

    /// Prints the residuals and fails if the largest is above the tolerance, or if there are none.
    #[track_caller]
    pub fn assert_below(&self, tolerance: f64) {
        assert!(self.count() > 0, "{}: nothing was compared", self.quantity);
        let row = self.row("", "", tolerance, Judge::Max);
        assert!(row.passed, "{row}");
    }
}

/// Differences of one quantity, gathered by the class of what they belong to.
pub struct Classes {
    quantity: &'static str,
    unit: &'static str,
    tolerance: f64,
    judged_by: Judge,
    found: BTreeMap<String, Differences>,
}

impl Classes {
    pub fn new(quantity: &'static str, unit: &'static str, tolerance: f64, judged_by: Judge) -> Classes {
        Classes { quantity, unit, tolerance, judged_by, found: BTreeMap::new() }
    }

    /// As [`Differences::push`], for a class.
    pub fn push(&mut self, class: &str, difference: f64, case: impl FnOnce() -> String) {
        if !self.found.contains_key(class) {
            let quantity = format!("{class}: {}", self.quantity);
            self.found.insert(class.to_owned(), Differences::new(quantity, self.unit));
        }
        if let Some(differences) = self.found.get_mut(class) {
            differences.push(difference, case);
        }
    }

    /// A row of the table for each class.
    ///
    /// - `model`: the models, or what stands in their place
    pub fn rows(&self, model: &str) -> Vec<Row> {
        self.found.values().map(|found| found.row("classes", model, self.tolerance, self.judged_by)).collect()
    }
}

impl std::fmt::Display for Row {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let number = |x: Option<f64>| x.map_or("–".to_owned(), |x| format!("{x:.1e}"));
        write!(
            f,
            "{} {} {} [{}]: n {}, median {}, q99 {}, max {} (accepted: {:.0e}, {:?}), beyond {}; worst: {}",
            self.component,
            self.model,
            self.quantity,
            self.unit,
            self.count,
            number(self.median),
            number(self.q99),
            number(self.max),
            self.tolerance,
            self.judged_by,
            self.n_outliers,
            self.worst_case
        )
    }
}

/// A row about things that are counted, not measured: `wrong` of `count`, of which none may be.
pub fn counted(component: &str, model: &str, quantity: &str, count: usize, wrong: &[String]) -> Row {
    Row {
        component: component.into(),
        model: model.into(),
        quantity: quantity.into(),
        unit: "number that differs".into(),
        count,
        median: None,
        q99: None,
        max: Some(wrong.len() as f64),
        n_not_a_number: 0,
        tolerance: 0.0,
        judged_by: Judge::Max,
        passed: count > 0 && wrong.is_empty(),
        worst_case: wrong.first().cloned().unwrap_or_default(),
        n_outliers: wrong.len(),
        outliers: wrong
            .iter()
            .take(LISTED_OUTLIERS)
            .map(|case| Outlier { case: case.clone(), difference: None, explanation: None })
            .collect(),
        remark: None,
    }
}

/// The folder for summaries, if one is named.
pub fn folder() -> Option<PathBuf> {
    std::env::var_os("CARPUS_VALIDATION_DIR").map(PathBuf::from)
}

/// Where OpenSim's numbers about models of the lab are kept between runs: in the folder for summaries, else under the
/// target folder.
pub fn reference_folder(subject: &str) -> PathBuf {
    let folder = folder().unwrap_or_else(|| PathBuf::from(env!("CARGO_TARGET_TMPDIR"))).join("reference").join(subject);
    std::fs::create_dir_all(&folder).expect("a folder for OpenSim's numbers");
    folder
}

/// Writes the rows of a subject as `SUBJECT.json`, for the table.
pub fn write(subject: &str, rows: &[Row]) {
    let Some(folder) = folder() else { return };
    let text = serde_json::to_string_pretty(rows).expect("JSON");
    std::fs::create_dir_all(&folder).expect("validation folder");
    std::fs::write(folder.join(format!("{subject}.json")), text + "\n").expect("summary written");
}

/// Fails with the rows that did not pass, and if there are none.
#[track_caller]
pub fn assert_passed(rows: &[Row]) {
    assert!(!rows.is_empty(), "nothing was compared");
    let failed: Vec<String> = rows.iter().filter(|row| !row.passed).map(ToString::to_string).collect();
    assert!(failed.is_empty(), "beyond tolerance:\n{}", failed.join("\n"));
}

#[test]
fn verif_rows_are_judged_by_what_they_say() {
    let mut differences = Differences::listing_above("length", "m", 0.5);
    for i in 0..100 {
        differences.push(if i == 7 { f64::NAN } else { 1e-3 * i as f64 }, || format!("pose {i}"));
    }
    let row = |judge| differences.row("paths", "model", 0.5, judge);
    assert!(row(Judge::Q99).passed && !row(Judge::Max).passed);
    assert_eq!((row(Judge::Q99).n_not_a_number, row(Judge::Q99).n_outliers), (1, 1), "not a number is an outlier");
    assert_eq!(row(Judge::Q99).outliers[0].case, "pose 7");
    assert_eq!((row(Judge::Q99).max, row(Judge::Q99).worst_case.as_str()), (Some(0.099), "pose 99"));
    assert_eq!(row(Judge::Q99).q99, Some(0.099));
    assert!(!Differences::new("nothing", "m").row("", "", 1.0, Judge::Max).passed, "nothing compared is no pass");
    assert!(!counted("reading", "model", "values", 0, &[]).passed);
}
