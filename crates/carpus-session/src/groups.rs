//! Which muscle parameters, effects or other values differ between groups of participants or between visits.

mod design;
mod quantities;

use std::path::{Path, PathBuf};

use nalgebra::DMatrix;
use serde::Serialize;
use serde_json::Value;

use super::account::{csv_text, digits, fixed};
use super::diagnostic::{Diagnostic, Failure};
use super::json;
use super::provenance::DEFAULT_SEED;
use super::study::Study;
use carpus_numerics::statistics::{Contrast, MixedModel, holm, mixed_model};
use carpus_report::article::{Article, Block, Section, TextTable, p_text, render_article};
use carpus_report::intervals::{IntervalRow, intervals_about};
use carpus_report::results::Provenance;

use design::Design;
pub use quantities::{Quantities, Quantity, QuantityKind};

/// Share of the prior variance below which trials say nothing of a muscle parameter: that of `carpus priors`.
const LEAST_SHARE: f64 = 0.02;

/// A comparison of groups or visits.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CompareGroups {
    /// Folders that `carpus identify`, or `carpus diagnose` of several participants, wrote for the study.
    pub results: Vec<PathBuf>,
    /// Tables with a column `participant` and columns of numbers.
    pub tables: Vec<PathBuf>,
    /// Written into the results; nothing in a comparison is random.
    pub seed: u64,
}

impl CompareGroups {
    /// Of folders of results.
    pub fn new(results: Vec<PathBuf>) -> CompareGroups {
        CompareGroups { results, tables: Vec::new(), seed: DEFAULT_SEED }
    }
}

/// A difference of a quantity between groups or visits.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// What the quantity is.
    pub kind: QuantityKind,
    /// The quantity.
    pub quantity: String,
    /// Its unit.
    pub unit: String,
    /// Which difference.
    pub difference: String,
    /// Estimate and test; of a muscle parameter, of the logarithm of its factor.
    #[serde(flatten)]
    pub test: Contrast,
    /// Of a muscle parameter: the ratio of the factors.
    pub ratio: Option<f64>,
    /// And its 95 % interval.
    pub ratio_interval_95: Option<[f64; 2]>,
    /// p-value after Holm's correction for all quantities of the kind.
    pub p_holm: f64,
    /// Standard deviation between persons.
    pub between_sd: f64,
    /// Standard deviation between measurements of one person.
    pub within_sd: f64,
    /// Persons.
    pub persons: usize,
    /// Measurements.
    pub measurements: usize,
    /// Mean share of the prior variance that the data removed, of muscle parameters.
    pub share_from_data: Option<f64>,
}

/// A quantity that cannot be compared.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct LeftOut {
    /// The quantity.
    pub quantity: String,
    /// Why.
    pub reason: String,
}

/// What differs between groups or visits.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GroupComparison {
    /// `carpus.groups/1`.
    pub schema: String,
    /// Groups and visits.
    pub cells: Vec<String>,
    /// All differences, by difference and then by quantity.
    pub differences: Vec<Difference>,
    /// Quantities that cannot be compared.
    pub left_out: Vec<LeftOut>,
    /// What the reader must know.
    pub warnings: Vec<String>,
    /// Program, command and inputs.
    pub provenance: Provenance,
    #[serde(skip)]
    title: String,
}

impl Study {
    /// Compares groups and visits by a linear mixed model with an intercept for every person.
    ///
    /// # Errors
    /// Participants of one group and visit only; results that are not of the study; nothing that can be compared.
    pub fn compare_groups(&self, request: &CompareGroups) -> Result<GroupComparison, Failure> {
        let participants = self.chosen();
        let design = Design::new(&self.tables, participants)?;
        let mut quantities = Quantities::default();
        quantities.read_results(&self.tables.settings.name, &request.results, participants)?;
        for table in &request.tables {
            quantities.read_table(table, &self.tables.participants, participants)?;
        }
        let mut left_out = Vec::new();
        let mut fitted = Vec::new();
        for quantity in &quantities.all {
            match design.fitted(quantity) {
                Ok(model) => fitted.push((quantity, model)),
                Err(reason) => left_out.push(LeftOut { quantity: quantity.name.clone(), reason }),
            }
        }
        if fitted.is_empty() {
            let reasons = left_out.iter().map(|l| Diagnostic::error(format!("{}: {}", l.quantity, l.reason)));
            let none = Diagnostic::error("there is no quantity that can be compared");
            return Err(Failure::Input(std::iter::once(none).chain(reasons).collect()));
        }
        let mut differences = Vec::new();
        for (name, weights) in &design.contrasts {
            let all = fitted.iter().map(|(q, model)| difference(q, model, name, weights));
            let mut all = all.collect::<Result<Vec<_>, _>>()?;
            for kind in [QuantityKind::MuscleParameter, QuantityKind::Effect, QuantityKind::Value] {
                let family: Vec<usize> = (0..all.len()).filter(|i| all[*i].kind == kind).collect();
                let p_values: Vec<f64> = family.iter().map(|i| all[*i].test.p_value).collect();
                family.iter().zip(holm(&p_values)).for_each(|(i, p)| all[*i].p_holm = p);
            }
            differences.extend(all);
        }
        Ok(GroupComparison {
            schema: "carpus.groups/1".to_owned(),
            warnings: design.warning().into_iter().collect(),
            cells: design.names,
            differences,
            left_out,
            provenance: self.provenance(request, request.seed, quantities.inputs),
            title: self.tables.settings.name.clone(),
        })
    }

    /// Writes the files of `carpus groups` into a folder of results. Returns what a person should know about files of
    /// earlier runs.
    ///
    /// # Errors
    /// The folder cannot be written to, or holds what is not of this study and command.
    pub fn write_groups(&self, found: &GroupComparison, path: &Path) -> Result<Vec<Diagnostic>, Failure> {
        self.write_results(path, "groups", |out| {
            out.write("groups.json", json::text(&json::value(found)?)?.as_bytes())?;
            out.write("groups.csv", found.csv()?.as_bytes())?;
            out.write("groups.html", found.report().as_bytes())?;
            Ok(())
        })
    }
}

impl Design {
    /// The model of a quantity, or why there is none.
    fn fitted(&self, quantity: &Quantity) -> Result<MixedModel, String> {
        if quantity.share_from_data.is_some_and(|share| share < LEAST_SHARE) {
            return Err("the trials say nothing of it: every estimate is that of the prior".to_owned());
        }
        let known: Vec<(usize, f64)> =
            quantity.values.iter().enumerate().filter_map(|(i, value)| Some((i, (*value)?))).collect();
        let is_empty = |cell: &usize| !known.iter().any(|(i, _)| self.cells[*i] == *cell);
        if let Some(cell) = (0..self.names.len()).find(is_empty) {
            return Err(format!("not known of any participant of: {}", self.names[cell]));
        }
        let y: Vec<f64> = known.iter().map(|(_, value)| *value).collect();
        let person: Vec<usize> = known.iter().map(|(i, _)| self.persons[*i]).collect();
        let cell = |row: usize| self.cells[known[row].0];
        let x = DMatrix::from_fn(y.len(), self.names.len(), |i, j| f64::from(u8::from(cell(i) == j)));
        mixed_model(&y, &x, &person).map_err(|e| e.to_string())
    }
}

fn difference(q: &Quantity, model: &MixedModel, name: &str, weights: &[f64]) -> Result<Difference, Failure> {
    let test = model.contrast(weights).map_err(|e| Failure::Internal(e.to_string()))?;
    let is_ratio = q.kind == QuantityKind::MuscleParameter;
    Ok(Difference {
        kind: q.kind,
        quantity: q.name.clone(),
        unit: q.unit.clone(),
        difference: name.to_owned(),
        test,
        ratio: is_ratio.then(|| test.estimate.exp()),
        ratio_interval_95: is_ratio.then(|| test.interval_95.map(f64::exp)),
        p_holm: test.p_value,
        between_sd: model.between.sqrt(),
        within_sd: model.within.sqrt(),
        persons: model.persons,
        measurements: model.observations,
        share_from_data: q.share_from_data,
    })
}

impl Difference {
    /// Estimate and interval as people read them: of a muscle parameter the ratio.
    fn shown(&self) -> (f64, [f64; 2]) {
        match (self.ratio, self.ratio_interval_95) {
            (Some(ratio), Some(interval)) => (ratio, interval),
            _ => (self.test.estimate, self.test.interval_95),
        }
    }

    fn quantity_and_unit(&self) -> String {
        if self.unit.is_empty() || self.unit == "1" || self.ratio.is_some() {
            self.quantity.clone()
        } else {
            format!("{} [{}]", self.quantity, self.unit)
        }
    }
}

impl GroupComparison {
    /// The difference with the smallest corrected p-value, in a sentence.
    pub fn in_words(&self) -> String {
        let found = self.differences.iter().filter(|d| d.p_holm < 0.05).count();
        let quantities = self.differences.iter().map(|d| &d.quantity).collect::<std::collections::BTreeSet<_>>().len();
        let of = match quantities {
            1 => "1 quantity".to_owned(),
            n => format!("{n} quantities"),
        };
        match found {
            0 => format!("{of}: none differs (p < 0.05 after Holm's correction)"),
            _ => {
                format!(
                    "{of}, {} comparisons: {found} differ (p < 0.05 after Holm's correction)",
                    self.differences.len()
                )
            }
        }
    }

    /// Heads of [`GroupComparison::rows`], and how many of them are words.
    pub const HEADER: ([&str; 8], usize) =
        (["difference", "quantity", "estimate", "95 % interval", "d", "df", "p", "p (Holm)"], 2);

    /// A row per difference and quantity, as people read it.
    pub fn rows(&self) -> Vec<Vec<String>> {
        self.differences.iter().map(Difference::row).collect()
    }

    fn csv(&self) -> Result<String, Failure> {
        let header = [
            "kind",
            "difference",
            "quantity",
            "unit",
            "estimate",
            "standard_error",
            "interval_95_low",
            "interval_95_high",
            "ratio",
            "ratio_interval_95_low",
            "ratio_interval_95_high",
            "df",
            "t",
            "p",
            "p_holm",
            "cohen_d",
            "cohen_d_interval_95_low",
            "cohen_d_interval_95_high",
            "between_sd",
            "within_sd",
            "persons",
            "measurements",
            "share_from_data",
        ];
        let row = |d: &Difference| {
            let t = &d.test;
            let kind = match d.kind {
                QuantityKind::MuscleParameter => "muscle_parameter",
                QuantityKind::Effect => "effect",
                QuantityKind::Value => "value",
            };
            let number = |v: Option<f64>| v.map(digits).unwrap_or_default();
            let mut row = vec![kind.to_owned(), d.difference.clone(), d.quantity.clone(), d.unit.clone()];
            row.extend([t.estimate, t.standard_error, t.interval_95[0], t.interval_95[1]].map(digits));
            row.extend([d.ratio, d.ratio_interval_95.map(|i| i[0]), d.ratio_interval_95.map(|i| i[1])].map(number));
            row.extend([t.df, t.t, t.p_value, d.p_holm, t.cohen_d].map(digits));
            row.extend(t.cohen_d_interval_95.map(digits));
            row.extend([d.between_sd, d.within_sd].map(digits));
            row.extend([d.persons.to_string(), d.measurements.to_string(), number(d.share_from_data)]);
            row
        };
        csv_text(header.iter(), self.differences.iter().map(row))
    }

    fn article(&self) -> Article {
        let table = TextTable {
            title: "Differences".to_owned(),
            header: Self::HEADER.0.map(str::to_owned).to_vec(),
            left_columns: Self::HEADER.1,
            rows: self.rows(),
            note: "Linear mixed model with an intercept for every person, restricted maximum likelihood, Satterthwaite's \
                   degrees of freedom. Muscle parameters: ratios of factors of the model's value. d: the difference over \
                   the standard deviation between measurements of different persons. Holm: corrected for all quantities \
                   of the kind."
                .to_owned(),
        };
        let mut blocks = vec![Block::Table(table)];
        if !self.left_out.is_empty() {
            blocks.push(Block::Table(TextTable {
                title: "Not compared".to_owned(),
                header: ["quantity", "why"].map(str::to_owned).to_vec(),
                left_columns: 2,
                rows: self.left_out.iter().map(|l| vec![l.quantity.clone(), l.reason.clone()]).collect(),
                note: String::new(),
            }));
        }
        let mut names: Vec<&str> = self.differences.iter().map(|d| d.difference.as_str()).collect();
        names.dedup();
        let figure = |name: &&str| {
            let of = self.differences.iter().filter(|d| d.difference == **name);
            let row = |d: &Difference| IntervalRow {
                label: d.quantity.clone(),
                value: d.test.cohen_d,
                interval: d.test.cohen_d_interval_95,
                ends: [d.p_holm < 0.05; 2],
            };
            let caption = format!("{name}: Cohen's d");
            (caption.clone(), intervals_about(0.0, &caption, &of.map(row).collect::<Vec<_>>()))
        };
        blocks.push(Block::Figures {
            title: "Sizes of the differences".to_owned(),
            note: "95 % intervals. Rose: p ≥ 0.05 after Holm's correction.".to_owned(),
            columns: 2,
            figures: names.iter().map(figure).collect(),
        });
        Article {
            title: "What differs between groups".to_owned(),
            kicker: format!("Comparison of groups · {}", self.title),
            lead: self.in_words() + ".",
            facts: vec![("groups and visits".to_owned(), self.cells.join("; "))],
            warnings: self.warnings.clone(),
            sections: vec![Section { id: "groups".to_owned(), title: "Differences".to_owned(), blocks }],
            provenance: self.provenance.clone(),
        }
    }

    /// The page of HTML.
    pub fn report(&self) -> String {
        render_article(&self.article())
    }

    /// For programs.
    ///
    /// # Errors
    /// None that input can cause.
    pub fn value(&self) -> Result<Value, Failure> {
        json::value(self)
    }
}

impl Difference {
    fn row(&self) -> Vec<String> {
        let (value, [low, high]) = self.shown();
        let decimals = 3;
        let df = if self.test.df.fract() == 0.0 { 0 } else { 1 };
        vec![
            self.difference.clone(),
            self.quantity_and_unit(),
            format!("{}{}", if self.ratio.is_some() { "× " } else { "" }, fixed(value, decimals)),
            format!("[{}, {}]", fixed(low, decimals), fixed(high, decimals)),
            fixed(self.test.cohen_d, 2),
            fixed(self.test.df, df),
            p_text(self.test.p_value),
            p_text(self.p_holm),
        ]
    }
}
