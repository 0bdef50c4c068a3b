//! What earlier fits say about the next participant, as a table of priors.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::{DMatrix, DVector};
use serde_json::json;

use super::account::{csv_text, digits};
use super::diagnostic::{Diagnostic, Failure};
use super::output::OutputFolder;
use super::progress::{Progress, go_on};
use super::provenance::DEFAULT_SEED;
use carpus_numerics::statistics::{Evidence, Population, population};
use carpus_report::identifiability::{IDENTIFIABILITY_SCHEMA, IdentifiabilityResult, ParameterKnowledge};

const RESULT: &str = "identifiability.json";
/// Fits below which the table is called thin.
const FEW: usize = 5;
/// From this share of what is known on, a fit's data say something of a parameter.
const LEAST_SHARE: f64 = 0.02;
/// Of a fit whose data leave next to nothing of the prior's variance.
const GREATEST_SHARE: f64 = 1.0 - 1e-9;

/// A question for prior knowledge.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LearnPriors {
    /// Folders of identifications (searched for `identifiability.json`), or such files.
    pub fits: Vec<PathBuf>,
    /// Seed of the integration over the spread between persons.
    pub seed: u64,
}

/// What is known of the next participant.
#[derive(Clone, Debug)]
pub struct LearnedPriors {
    /// The files that were read.
    pub files: Vec<PathBuf>,
    /// Parameter by parameter.
    pub known: Vec<Known>,
}

impl LearnPriors {
    /// The fits in folders.
    pub fn new(fits: Vec<PathBuf>) -> LearnPriors {
        LearnPriors { fits, seed: DEFAULT_SEED }
    }

    /// Reads the fits and sums them up.
    ///
    /// # Errors
    /// No fits; a file that is none; a participant twice; a request to stop.
    pub fn run(&self, progress: &dyn Progress) -> Result<LearnedPriors, Failure> {
        let mut files = Vec::new();
        for path in &self.fits {
            let before = files.len();
            collect(path, &mut files)?;
            if files.len() == before {
                let hint = "expected a folder that carpus identify or carpus study wrote";
                return Err(Diagnostic::error(format!("no {RESULT} in it")).in_file(path).hint(hint).into());
            }
        }
        let fits = files.iter().map(|file| read(file)).collect::<Result<Vec<_>, _>>()?;
        refuse_twice(&files, &fits)?;
        go_on(progress)?;
        let known = knowledge(&fits, self.seed)?;
        if fits.len() < FEW {
            let text =
                format!("{} earlier fits: the spread between persons is mostly what the bounds allow", fits.len());
            progress.warning(&Diagnostic::warning(text));
        }
        Ok(LearnedPriors { files, known })
    }
}

impl LearnedPriors {
    /// Writes the table that an identification takes as priors. Its path comes back.
    ///
    /// # Errors
    /// The disk.
    pub fn write(&self, file: &Path) -> Result<PathBuf, Failure> {
        let folder = file.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let Some(name) = file.file_name() else {
            return Err(Diagnostic::error("expected a file to write").in_file(file).into());
        };
        let rows = self.known.iter().map(|k| {
            let sd = k.next.mean.exp() * (k.next.sd.powi(2).exp() - 1.0).sqrt();
            let source = format!("population of {} earlier fits", k.fits);
            let [mean, sd] = [k.next.mean.exp(), sd].map(digits);
            vec![k.muscle.clone(), k.property.clone(), mean, sd, "model".to_string(), source]
        });
        let csv = csv_text(["muscle", "property", "mean", "sd", "unit", "source"].iter(), rows)?;
        OutputFolder::create(folder, &self.files)?.write(name, csv.as_bytes())
    }

    /// For programs.
    ///
    /// - `file`: where the table was written
    pub fn value(&self, file: &Path) -> serde_json::Value {
        let priors: Vec<_> = self.known.iter().map(Known::value).collect();
        json!({
            "schema": "carpus.priors/1", "fits": self.files.len(), "file": file.display().to_string(), "priors": priors,
        })
    }
}

/// Result files at or below `path`, in order.
fn collect(path: &Path, files: &mut Vec<PathBuf>) -> Result<(), Failure> {
    let unreadable = |e: std::io::Error| Diagnostic::error(format!("cannot be read: {e}")).in_file(path);
    // What is no folder is read as a file, which says what is wrong with a device or a pipe.
    if !path.metadata().map_err(unreadable)?.is_dir() {
        files.push(path.to_owned());
        return Ok(());
    }
    let entries = std::fs::read_dir(path).map_err(unreadable)?.collect::<Result<Vec<_>, _>>().map_err(unreadable)?;
    let mut below: Vec<PathBuf> = entries.iter().map(std::fs::DirEntry::path).collect();
    below.sort();
    for entry in below {
        // Links are not followed: a folder may hold one to itself.
        let kind = entry.symlink_metadata().map_err(unreadable)?.file_type();
        if kind.is_dir() {
            collect(&entry, files)?;
        } else if kind.is_file() && entry.file_name().is_some_and(|name| name == RESULT) {
            files.push(entry);
        }
    }
    Ok(())
}

fn read(file: &Path) -> Result<IdentifiabilityResult, Failure> {
    let fault =
        |what: String| Failure::from(Diagnostic::error(what).in_file(file).hint("is it what carpus identify wrote?"));
    let text = carpus_numerics::regular_file::read_text(file).map_err(|e| fault(format!("cannot be read: {e}")))?;
    let result: IdentifiabilityResult =
        serde_json::from_str(&text).map_err(|e| fault(format!("not a result of carpus identify: {e}")))?;
    if result.schema != IDENTIFIABILITY_SCHEMA {
        return Err(fault(format!("schema `{}`, expected `{IDENTIFIABILITY_SCHEMA}`", result.schema)));
    }
    Ok(result)
}

/// A person counts once.
fn refuse_twice(files: &[PathBuf], fits: &[IdentifiabilityResult]) -> Result<(), Failure> {
    let mut seen: BTreeMap<(&str, &str), &Path> = BTreeMap::new();
    for (file, fit) in files.iter().zip(fits) {
        if let Some(first) = seen.insert((&fit.study, &fit.participant), file) {
            let text = format!("{} of study `{}` is in {} already", fit.participant, fit.study, first.display());
            return Err(Diagnostic::error(text).in_file(file).hint("name every participant's fit once").into());
        }
    }
    Ok(())
}

/// What is known of a parameter of the next participant.
#[derive(Clone, Debug)]
pub struct Known {
    /// The muscle.
    pub muscle: String,
    /// OpenSim property name.
    pub property: String,
    /// Of the logarithm of the factor of the model's value.
    pub next: Population,
    /// Standard deviation of that logarithm before anyone was measured.
    pub before: f64,
    /// Fits whose data say something of it.
    pub fits: usize,
}

impl Known {
    /// For programs.
    pub fn value(&self) -> serde_json::Value {
        json!({
            "muscle": self.muscle, "property": self.property, "factor": self.next.mean.exp(), "log_sd": self.next.sd,
            "between_log_sd": self.next.between, "before_log_sd": self.before, "fits": self.fits,
        })
    }
}

/// Per parameter what the fits say together, in the order in which the parameters first appear.
fn knowledge(fits: &[IdentifiabilityResult], seed: u64) -> Result<Vec<Known>, Failure> {
    let mut names: Vec<(&str, &str)> = Vec::new();
    let mut priors: Vec<[f64; 2]> = Vec::new();
    let mut counts: Vec<usize> = Vec::new();
    for parameter in fits.iter().flat_map(|f| &f.parameters) {
        let known = names.iter().position(|name| *name == name_of(parameter));
        let k = known.unwrap_or_else(|| {
            names.push(name_of(parameter));
            priors.push([0.0; 2]);
            counts.push(0);
            names.len() - 1
        });
        // The widest of the fits' priors is what was known before anyone was measured.
        let own = prior(parameter);
        if own[1] > priors[k][1] {
            priors[k] = own;
        }
        counts[k] += usize::from(parameter.share_from_data >= LEAST_SHARE);
    }
    if counts.iter().all(|count| *count == 0) {
        return Err(Diagnostic::error("the data of these fits say nothing about any parameter").into());
    }
    let persons = fits.iter().map(|fit| evidence(fit, &names, &priors)).collect::<Result<Vec<_>, _>>()?;
    let before = DVector::from_iterator(names.len(), priors.iter().map(|p| p[1]));
    let found = population(&persons, &before, seed).map_err(|e| Failure::from(Diagnostic::error(e.to_string())))?;
    let all = names.iter().zip(&priors).zip(found).zip(counts).filter(|(_, fits)| *fits > 0);
    let known = all.map(|(((name, prior), next), fits)| Known {
        muscle: name.0.to_string(),
        property: name.1.to_string(),
        next: Population { mean: next.mean + prior[0], ..next },
        before: prior[1],
        fits,
    });
    Ok(known.collect())
}

fn name_of(p: &ParameterKnowledge) -> (&str, &str) {
    (&p.muscle, &p.property)
}

/// Most probable logarithm of the factor before the data, and its standard deviation.
fn prior(p: &ParameterKnowledge) -> [f64; 2] {
    [(p.prior_value / p.model).ln(), p.prior_log_sd]
}

/// What a fit's data alone say about the logarithms of the factors, from `priors` on: the posterior without the fit's
/// own prior, both taken as normal.
fn evidence(fit: &IdentifiabilityResult, names: &[(&str, &str)], priors: &[[f64; 2]]) -> Result<Evidence, Failure> {
    let n = fit.parameters.len();
    let faulty = || {
        let text =
            format!("{} of study `{}`: correlations that do not go with its parameters", fit.participant, fit.study);
        Failure::from(Diagnostic::error(text))
    };
    if fit.correlations.len() != n || fit.correlations.iter().any(|row| row.len() != n) {
        return Err(faulty());
    }
    // In units of the prior's standard deviations.
    let left = |p: &ParameterKnowledge| (1.0 - p.share_from_data.clamp(0.0, GREATEST_SHARE)).sqrt();
    let spread: Vec<f64> = fit.parameters.iter().map(left).collect();
    let covariance = DMatrix::from_fn(n, n, |i, j| match i == j {
        true => spread[i] * spread[i],
        false => 0.5 * (fit.correlations[i][j] + fit.correlations[j][i]) * spread[i] * spread[j],
    });
    let moved = DVector::from_iterator(
        n,
        fit.parameters.iter().map(|p| {
            let [value, sd] = prior(p);
            ((p.posterior_median / p.model).ln() - value) / sd
        }),
    );
    if !covariance.iter().chain(moved.iter()).all(|v| v.is_finite()) {
        return Err(faulty());
    }
    let Evidence { information: own, weighted } = Evidence::of_posterior(covariance, &moved);
    let mut all =
        Evidence { information: DMatrix::zeros(names.len(), names.len()), weighted: DVector::zeros(names.len()) };
    let place: Vec<usize> =
        fit.parameters.iter().filter_map(|p| names.iter().position(|name| *name == name_of(p))).collect();
    let sd = |i: usize| prior(&fit.parameters[i])[1];
    for i in 0..n {
        all.weighted[place[i]] += weighted[i] / sd(i);
        for j in 0..n {
            all.information[(place[i], place[j])] += own[(i, j)] / (sd(i) * sd(j));
        }
    }
    // Counted from the common prior instead of the fit's own.
    let shift = DVector::from_fn(names.len(), |k, _| match place.iter().position(|p| *p == k) {
        Some(i) => prior(&fit.parameters[i])[0] - priors[k][0],
        None => 0.0,
    });
    all.weighted += &all.information * shift;
    Ok(all)
}
