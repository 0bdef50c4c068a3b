//! What several participants' diagnoses say together: `cohort.json` and `cohort.html`.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::Value;

use super::account::fixed;
use super::candidates::names_of;
use super::diagnose::{Diagnose, Diagnosed};
use super::diagnostic::{Diagnostic, Failure};
use super::json;
use super::output::OutputFolder;
use super::study::Study;
use carpus_diagnosis::cohort::{CohortDiagnosis, CohortEffect, Member, ParticipantEvidence, WithInterval, pooled};
use carpus_report::article::{Article, Block, Section, TextTable, render_article};
use carpus_report::intervals::{IntervalRow, intervals_about};
use carpus_report::results::{InputFile, Provenance};

/// A participant has an effect if that is more probable than not.
const HAS_IT: f64 = 0.5;
/// A participant deviates from the population by more than this [standard deviations].
const DEVIATES: f64 = 2.6;
/// Other effects that are listed.
const OTHERS: usize = 8;

/// The diagnosis of a cohort.
#[derive(Clone, Debug, PartialEq)]
pub struct Cohort {
    /// Effects that the participants share.
    pub diagnosis: CohortDiagnosis,
    provenance: Provenance,
    title: String,
}

impl Study {
    /// What diagnoses of several participants say together; `None` of fewer than two.
    ///
    /// - `evidence`: of every participant, in the study's order; `inputs`: their files
    pub fn cohort(
        &self,
        evidence: &[ParticipantEvidence],
        request: &Diagnose,
        inputs: Vec<InputFile>,
    ) -> Option<Cohort> {
        (evidence.len() > 1).then(|| Cohort {
            diagnosis: pooled(evidence),
            provenance: self.provenance(request, request.seed, inputs),
            title: self.tables.settings.name.clone(),
        })
    }

    /// Writes the files of `carpus diagnose` of several participants into a folder of results. Returns what a person
    /// should know about files of earlier runs.
    ///
    /// - `diagnosed`: of every participant, in the study's order
    ///
    /// # Errors
    /// The folder cannot be written to, or holds what is not of this study and command.
    pub fn write_cohort(
        &self,
        cohort: &Cohort,
        diagnosed: &[&Diagnosed<'_>],
        path: &Path,
    ) -> Result<Vec<Diagnostic>, Failure> {
        self.write_results(path, "diagnose", |out| {
            for d in diagnosed {
                d.write_to(out, Path::new(&d.diagnosis.participant))?;
            }
            cohort.write_to(out)
        })
    }
}

impl Cohort {
    /// The content of `cohort.json`.
    ///
    /// # Errors
    /// None that input can cause.
    pub fn value(&self) -> Result<Value, Failure> {
        let mut value = json::value(&self.diagnosis)?;
        value["provenance"] = json::value(&self.provenance)?;
        Ok(value)
    }

    /// The page of HTML.
    pub fn report(&self) -> String {
        render_article(&self.article())
    }

    /// Writes `cohort.json` and `cohort.html` at the top of the folder of results.
    ///
    /// # Errors
    /// The disk.
    pub fn write_to(&self, out: &OutputFolder) -> Result<(), Failure> {
        out.write("cohort.json", json::text(&self.value()?)?.as_bytes())?;
        out.write("cohort.html", self.report().as_bytes())?;
        Ok(())
    }

    /// What was found, in a sentence.
    pub fn in_words(&self) -> String {
        let n = self.diagnosis.participants.len();
        if self.diagnosis.effects.is_empty() {
            return format!("{n} participants together: no effect that they share, and none that some of them have");
        }
        let one = |e: &CohortEffect| {
            let has = e.participants.iter().filter(|m| m.probability > HAS_IT).count();
            format!("{} ({has} of {})", names(&e.group), e.participants.len())
        };
        let effects = self.diagnosis.effects.iter().map(one).collect::<Vec<_>>().join("; ");
        format!("{n} participants together: {effects}")
    }

    /// A row per amplitude of every effect that the cohort has.
    pub fn rows(&self) -> Vec<Vec<String>> {
        let of_effect = |e: &CohortEffect| {
            let row = |(i, (name, size)): (usize, (&String, &carpus_diagnosis::cohort::PopulationSize))| {
                let unit = if size.unit == "1" { "" } else { size.unit.as_str() };
                let cell = |text: String| if i == 0 { text } else { String::new() };
                vec![
                    cell(names(&e.group)),
                    cell(fixed(e.probability, 2)),
                    cell(with_interval(&e.prevalence, 1)),
                    name.clone(),
                    format!("{} {unit}", with_interval(&size.mean, 4)).trim_end().to_owned(),
                    with_interval(&size.spread, 4),
                    cell(those_who_have_it(e)),
                ]
            };
            e.parameters.iter().enumerate().map(row).collect::<Vec<_>>()
        };
        self.diagnosis.effects.iter().flat_map(of_effect).collect()
    }

    /// Heads of [`Cohort::rows`], and how many of them are words.
    pub const HEADER: ([&str; 7], usize) =
        (["effect", "probability", "share that has it", "parameter", "mean", "spread", "who has it"], 1);

    fn article(&self) -> Article {
        let mut blocks = Vec::new();
        if !self.diagnosis.effects.is_empty() {
            blocks.push(Block::Table(TextTable {
                title: "Effects that the participants share".to_owned(),
                header: Self::HEADER.0.iter().map(|h| (*h).to_owned()).collect(),
                left_columns: Self::HEADER.1,
                rows: self.rows(),
                note: "Mean and standard deviation over the population of those that have the effect, with 95 % \
                       intervals. An effect that may stand in another's place is named with it."
                    .to_owned(),
            }));
        }
        let mut others: Vec<(&String, f64)> = self.diagnosis.others.iter().map(|(id, p)| (id, *p)).collect();
        others.sort_by(|a, b| b.1.total_cmp(&a.1));
        blocks.push(Block::Table(TextTable {
            title: "Other effects".to_owned(),
            header: ["effect", "probability that the cohort has it, too"].map(str::to_owned).to_vec(),
            left_columns: 1,
            rows: others.iter().take(OTHERS).map(|(id, p)| vec![names(&[(*id).clone()]), fixed(*p, 2)]).collect(),
            note: format!("The {} most probable of {}.", others.len().min(OTHERS), others.len()),
        }));
        let mut sections = vec![Section { id: "effects".into(), title: "Effects".into(), blocks }];
        sections.extend(self.diagnosis.effects.iter().map(section));
        Article {
            title: "What the participants have in common".to_owned(),
            kicker: format!("Diagnosis of a cohort · {}", self.title),
            lead: self.in_words() + ".",
            facts: vec![("participants".to_owned(), self.diagnosis.participants.len().to_string())],
            warnings: Vec::new(),
            sections,
            provenance: self.provenance.clone(),
        }
    }
}

/// The section of an effect: its participants, alone and pooled.
fn section(effect: &CohortEffect) -> Section {
    let mut figures = Vec::new();
    let mut rows: BTreeMap<usize, Vec<String>> = BTreeMap::new();
    for (name, size) in &effect.parameters {
        let unit = if size.unit == "1" { String::new() } else { format!(" [{}]", size.unit) };
        for (which, pooled) in [("alone", false), ("with the others as prior knowledge", true)] {
            let row = |m: &Member| {
                let size = &m.parameters[name];
                let of = if pooled { &size.pooled } else { &size.alone };
                let has = m.probability > HAS_IT;
                IntervalRow { label: m.participant.clone(), value: of.value, interval: of.ci95, ends: [has, has] }
            };
            let rows: Vec<IntervalRow> = effect.participants.iter().map(row).collect();
            let caption = format!("{name}{unit}, {which}");
            figures.push((caption.clone(), intervals_about(size.mean.value, &caption, &rows)));
        }
        for (i, m) in effect.participants.iter().enumerate() {
            let size = &m.parameters[name];
            let row = rows.entry(i).or_insert_with(|| {
                let deviates = if m.deviation.abs() > DEVIATES { "*" } else { "" };
                vec![m.participant.clone(), fixed(m.probability, 2), format!("{}{deviates}", fixed(m.deviation, 1))]
            });
            row.push(with_interval(&size.alone, 4));
            row.push(with_interval(&size.pooled, 4));
        }
    }
    let mut header = vec!["participant".to_owned(), "has it".to_owned(), "deviation".to_owned()];
    header.extend(effect.parameters.keys().flat_map(|name| [format!("{name}, alone"), format!("{name}, pooled")]));
    Section {
        id: effect.effect.clone(),
        title: names(&effect.group),
        blocks: vec![
            Block::Figures {
                title: "Sizes".to_owned(),
                note: "Line: mean of the population. Rose: more probably without the effect; the pooled size is then \
                       what it would be with it."
                    .to_owned(),
                columns: 4,
                figures,
            },
            Block::Table(TextTable {
                title: "Every participant".to_owned(),
                header,
                left_columns: 1,
                rows: rows.into_values().collect(),
                note: format!(
                    "Has it: probability. Deviation: from the population's mean, in standard deviations of both; * \
                     beyond {DEVIATES}."
                ),
            }),
        ],
    }
}

/// Those that have an effect, more probably than not.
fn those_who_have_it(effect: &CohortEffect) -> String {
    let has: Vec<&str> =
        effect.participants.iter().filter(|m| m.probability > HAS_IT).map(|m| m.participant.as_str()).collect();
    if has.len() == effect.participants.len() { "all".to_owned() } else { has.join(" ") }
}

fn names(group: &[String]) -> String {
    group.iter().map(|id| names_of(&[id.as_str()])).collect::<Vec<_>>().join(" / ")
}

fn with_interval(v: &WithInterval, digits: usize) -> String {
    format!("{} [{}, {}]", fixed(v.value, digits), fixed(v.ci95[0], digits), fixed(v.ci95[1], digits))
}
