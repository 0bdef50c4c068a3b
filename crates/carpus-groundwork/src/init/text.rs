//! The three files of a proposed study.

use std::fmt::Write;

use super::columns::EmgKind;
use super::draft::Draft;
use super::piece::{Clock, Piece};
use super::proposal::ProposedTrial;
use crate::account::csv_text;
use crate::diagnostic::Failure;
use crate::output::OutputFolder;
use carpus_study::study::write::{participant_rows, toml_string};

/// Samples a second of a trial with raw EMG [Hz]: muscles and movements are slower.
const TRIAL_RATE_HZ: f64 = 100.0;
/// Rates from which on raw EMG is averaged to that [Hz].
const FASTER_HZ: f64 = 200.0;

impl Draft {
    /// Writes the files.
    ///
    /// # Errors
    /// The disk.
    pub fn write(&self, folder: &OutputFolder) -> Result<(), Failure> {
        folder.put("study.toml".as_ref(), self.settings().as_bytes())?;
        let rows = participant_rows(&self.people.iter().map(|p| (p, None)).collect::<Vec<_>>());
        folder.put("participants.csv".as_ref(), table(rows)?.as_bytes())?;
        folder.put("trials.csv".as_ref(), table(self.trial_rows())?.as_bytes())?;
        Ok(())
    }

    fn settings(&self) -> String {
        let mut text = String::new();
        let p = &self.pieces;
        let mut line = |what: String| {
            text.push_str(&what);
            text.push('\n');
        };
        line("# Proposed by carpus init; every line may be changed. Keys: docs, \"Study folder\".".to_owned());
        line(format!("[study]\nname = {}\nmodel = {}", toml_string(&self.name), toml_string(&self.model)));
        line(format!("recordings = {}   # files of trials.csv are relative to it", toml_string(&self.recordings)));
        line(format!("\n[dynamometer]\ncoordinate = {}", toml_string(&self.coordinate)));
        line("damping_n_m_s_per_deg = 0   # drag of the machine itself: carpus dynamometer-drag finds it".to_owned());
        line(
            "include = [\"muscles\", \"passive\"]   # \"gravity\", \"inertia\": if the machine \
             does not correct for them"
                .to_owned(),
        );
        line("\n[posture_deg]   # coordinates that were held; others keep the model's default".to_owned());
        for held in &self.posture {
            let crossing = held.muscles.join(", ");
            let remark = if held.is_default { "the model's default" } else { "assumed" };
            line(format!("{} = {}   # {remark}; crossed by {crossing}", key(&held.name), held.value_deg));
        }
        let muscles: Vec<String> = p.muscles.iter().map(|m| toml_string(m)).collect();
        line(format!("\n[muscles]\nactive = [{}]", muscles.join(", ")));
        match p.emg_kind {
            EmgKind::Raw => {
                line("\n[emg]\nkind = \"raw\"".to_owned());
                line("mvc_window_s = 0.5   # the maximum is the largest mean over this time".to_owned());
                let fastest = if p.clock == Clock::Same { p.rates_hz[1] } else { p.rates_hz[0] };
                if fastest > FASTER_HZ {
                    line(format!("resample_hz = {TRIAL_RATE_HZ}   # of the trials, after the envelope"));
                }
            }
            _ => line("\n[emg]\nkind = \"normalized\"".to_owned()),
        }
        match &p.clock {
            Clock::Same => {}
            Clock::Trigger => line(
                "\n[emg_recorder]   # EMG in files of its own: emg_file of trials.csv\ndelay_s = 0   # is added to its \
                 clock; 0: one trigger started both"
                    .to_owned(),
            ),
            Clock::Shared(shared) => line(format!(
                "\n[emg_recorder]   # EMG in files of its own: emg_file of trials.csv\nshared = {}   # both recorded \
                 it: its delay sets the clock\nshared_with = {}\nmax_delay_s = 2",
                toml_string(shared),
                toml_string(&p.moment.name)
            )),
        }
        line("\n[columns]".to_owned());
        line(format!("time = {}", column(&p.time, 1.0, "s")));
        let unit = if p.is_radians { "rad" } else { "deg" };
        line(format!("angle = {}", column(&p.angle, 1.0, unit)));
        if let Some(velocity) = p.velocity.as_ref().filter(|_| self.velocity_used) {
            line(format!("velocity = {}", column(velocity, 1.0, "deg/s")));
        }
        line(format!("moment = {}", column(&p.moment, self.moment_sign, "N·m")));
        line(emg(&p.emg, p.emg_kind));
        let unused = p.velocity.iter().filter(|_| !self.velocity_used).map(|v| &v.name);
        let ignore: Vec<String> = p.ignore.iter().chain(unused).map(|name| toml_string(name)).collect();
        if !ignore.is_empty() {
            line(format!("ignore = [{}]   # there and not used", ignore.join(", ")));
        }
        text
    }

    fn trial_rows(&self) -> Vec<Vec<String>> {
        let apart = self.trials.iter().any(|t| t.emg_file.is_some());
        let mut header: Vec<String> =
            ["participant", "file", "contraction", "effort_percent", "direction", "posture_deg", "repetition", "use"]
                .map(String::from)
                .to_vec();
        header.extend(apart.then(|| "emg_file".to_owned()));
        let [tables, emg_tables] =
            [self.trials.iter().any(|t| t.table.is_some()), self.trials.iter().any(|t| t.emg_table.is_some())];
        header.extend(tables.then(|| "table".to_owned()));
        header.extend(emg_tables.then(|| "emg_table".to_owned()));
        let row = |t: &ProposedTrial| {
            let number = |v: Option<f64>| v.map(|v| v.to_string()).unwrap_or_default();
            let mut row = vec![
                t.participant.clone(),
                t.file.clone(),
                t.contraction.clone(),
                number(t.effort_percent),
                t.direction.clone(),
                number(t.posture_deg),
                t.repetition.map(|r| r.to_string()).unwrap_or_default(),
                t.usage.clone(),
            ];
            row.extend(apart.then(|| t.emg_file.clone().unwrap_or_default()));
            row.extend(tables.then(|| t.table.clone().unwrap_or_default()));
            row.extend(emg_tables.then(|| t.emg_table.clone().unwrap_or_default()));
            row
        };
        std::iter::once(header).chain(self.trials.iter().map(row)).collect()
    }
}

fn table(rows: Vec<Vec<String>>) -> Result<String, Failure> {
    let mut rows = rows.into_iter();
    let header = rows.next().unwrap_or_default();
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    csv_text(header.iter(), rows)
}

/// A column as study.toml writes it.
///
/// - `sign`: times that of the piece
/// - `usual`: the unit if the file states none
fn column(piece: &Piece, sign: f64, usual: &str) -> String {
    let unit = piece.unit.map_or(usual, |unit| unit.symbol);
    let mut text = format!("{{ column = {}, unit = {}", toml_string(&piece.name), toml_string(unit));
    if sign * piece.sign < 0.0 {
        text.push_str(", sign = -1");
    }
    if piece.offset != 0.0 {
        let _ = write!(text, ", offset = {}", piece.offset);
    }
    text.push_str(" }");
    text
}

fn emg(channels: &[(String, String)], kind: EmgKind) -> String {
    let one = |(muscle, name): &(String, String)| {
        let name = toml_string(name);
        match kind {
            EmgKind::Percent => format!("{} = {{ column = {name}, unit = \"%\" }}", key(muscle)),
            _ => format!("{} = {name}", key(muscle)),
        }
    };
    format!("emg = {{ {} }}", channels.iter().map(one).collect::<Vec<_>>().join(", "))
}

/// A key, bare where TOML allows it.
fn key(name: &str) -> String {
    let bare = !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-');
    if bare { name.to_owned() } else { toml_string(name) }
}
