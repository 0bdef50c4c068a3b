//! The files of a folder: which are recordings of what, who they are of, and what each trial is.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::columns::{self, Column, EmgKind, Role};
use super::conditions::{self, Named};
use super::coordinate::Chosen;
use super::{Draft, Note, ProposedTrial, muscles, people};
use crate::account::fixed;
use crate::diagnostic::{Diagnostic, Failure};
use crate::model::LoadedModel;
use carpus_numerics::plausible::NamedUnit;
use carpus_study::study::{Contraction, Direction, Exported, Participant, nearest};

/// Ends of names of files that may be tables of numbers.
const TEXT_FILES: [&str; 7] = ["csv", "txt", "tsv", "dat", "asc", "tab", "prn"];
/// Most files that are looked at.
const MOST_FILES: usize = 5000;
/// Travel from which on a joint moves [deg].
const MOVES_DEG: f64 = 6.0;
/// A joint that is moved with less than this part of the largest moment is relaxed.
const RELAXED_PART: f64 = 0.15;
/// Words of names that say which recorder a file is of.
const RECORDERS: [&str; 16] = [
    "emg",
    "semg",
    "delsys",
    "trigno",
    "noraxon",
    "biodex",
    "humac",
    "cybex",
    "raw",
    "export",
    "torque",
    "dyno",
    "dynamometer",
    "data",
    "isomed",
    "contrex",
];

/// A column of the study: its name in the files, and how its numbers are read.
#[derive(Clone, Debug, PartialEq)]
pub struct Piece {
    /// Its name.
    pub name: String,
    /// The unit that the file states.
    pub unit: Option<&'static NamedUnit>,
    /// 1 or −1.
    pub sign: f64,
    /// Added after conversion, in the study's unit.
    pub offset: f64,
}

impl Piece {
    fn of(column: &Column) -> Piece {
        Piece { name: column.name.clone(), unit: column.unit, sign: 1.0, offset: 0.0 }
    }
}

/// How the clock of the EMG's recorder is set.
#[derive(Clone, Debug, PartialEq)]
pub enum Clock {
    /// One file.
    Same,
    /// One trigger.
    Trigger,
    /// By the dynamometer's torque, which the EMG's recorder took, too.
    Shared(String),
}

/// Which columns the study has.
#[derive(Clone, Debug)]
pub struct Pieces {
    /// Time.
    pub time: Piece,
    /// Angle.
    pub angle: Piece,
    /// Whether angles are in radians though no unit says so.
    pub is_radians: bool,
    /// Speed.
    pub velocity: Option<Piece>,
    /// Moment.
    pub moment: Piece,
    /// Muscle and column of its EMG.
    pub emg: Vec<(String, String)>,
    /// The muscles.
    pub muscles: Vec<String>,
    /// How EMG was recorded.
    pub emg_kind: EmgKind,
    /// Columns that are there and not used.
    pub ignore: Vec<String>,
    /// How the recorders' clocks are set.
    pub clock: Clock,
    /// Rates of the dynamometer and the EMG [Hz].
    pub rates_hz: [f64; 2],
    /// Whether a participant has maximum contractions for raw EMG.
    pub has_mvc: bool,
}

/// A file of the dynamometer.
#[derive(Clone, Debug)]
pub struct Recording {
    path: PathBuf,
    participant: String,
    named: Named,
    emg: Option<PathBuf>,
    /// Angle and moment as recorded.
    angle: Vec<f64>,
    moment: Vec<f64>,
}

/// What was found in a folder.
pub struct Found {
    folder: PathBuf,
    recordings: Vec<Recording>,
    people: Vec<Participant>,
    /// The columns.
    pub pieces: Pieces,
    /// What was assumed.
    pub assumed: Vec<Note>,
    /// What could not be told.
    pub unknown: Vec<Note>,
    understood: Vec<(String, String)>,
}

struct Read {
    path: PathBuf,
    exported: Exported,
    columns: Vec<Column>,
}

impl Read {
    fn has(&self, role: &Role) -> bool {
        self.columns.iter().any(|column| column.role == *role)
    }

    fn has_emg(&self) -> bool {
        self.columns.iter().any(|column| matches!(column.role, Role::Emg(_)))
    }

    fn piece(&self, role: &Role) -> Option<Piece> {
        self.columns.iter().find(|column| column.role == *role).map(Piece::of)
    }

    fn samples(&self, role: &Role) -> Vec<f64> {
        let place = self.columns.iter().position(|column| column.role == *role);
        let samples = place.map(|i| self.exported.columns[i].as_slice()).unwrap_or_default();
        samples.iter().copied().filter(|x| x.is_finite()).collect()
    }

    /// Samples a second of a column [Hz].
    fn rate_hz(&self, column: usize) -> f64 {
        let Some(clock) = self.exported.clock_of(column) else { return f64::NAN };
        let times: Vec<f64> = self.exported.columns[clock].iter().copied().filter(|t| t.is_finite()).collect();
        let factor = self.columns[clock].unit.map_or(1.0, |unit| unit.factor);
        let span = times.last().zip(times.first()).map_or(f64::NAN, |(last, first)| last - first);
        (times.len() as f64 - 1.0) / (factor * span)
    }

    fn layout(&self) -> Vec<(&str, bool)> {
        let is_used = |column: &Column| !matches!(column.role, Role::Other | Role::OtherEmg);
        self.columns.iter().map(|column| (column.name.as_str(), is_used(column))).collect()
    }
}

impl Found {
    /// Looks at all files of a folder.
    ///
    /// # Errors
    /// The folder; no recordings that a study can be made of.
    pub fn of(folder: &Path, loaded: &LoadedModel) -> Result<Found, Failure> {
        let (mut assumed, mut unknown) = (Vec::new(), Vec::new());
        let (files, others) = files(folder)?;
        let model_muscles: Vec<&str> = loaded.file.spec.muscles.iter().map(|m| m.name.as_str()).collect();
        let looked: Vec<(PathBuf, Option<Read>)> = files
            .into_par_iter()
            .map(|path| {
                let read = Exported::read(&path).ok().map(|exported| {
                    let columns = columns::columns(&exported, &model_muscles);
                    Read { path: path.clone(), exported, columns }
                });
                (path, read)
            })
            .collect();
        let mut people = Vec::new();
        let (mut dynamometer, mut emg, mut left): (Vec<Read>, Vec<Read>, Vec<PathBuf>) = Default::default();
        for (path, read) in looked {
            match read {
                Some(read) if read.has(&Role::Moment) && read.has(&Role::Angle) && read.has(&Role::Time) => {
                    dynamometer.push(read);
                }
                Some(read) if read.has_emg() => emg.push(read),
                _ => match people::read(&path) {
                    Some(found) => people.extend(found),
                    None => left.push(path),
                },
            }
        }
        left.extend(others);
        note_left(folder, &left, &mut unknown);
        let first = dynamometer.first().ok_or_else(|| {
            let text = "no file with a time, an angle and a torque was found";
            let hint = "columns are known by names such as Time, Position or Angle, Torque or Moment, and by their units; \
                        carpus reads text: .csv, .txt, .tsv (C3D: carpus c3d; .mat and .xlsx: export them as CSV)";
            Failure::from(Diagnostic::error(text).in_file(folder).hint(hint))
        })?;
        // The layout that most files have is the study's.
        let mut layouts: BTreeMap<Vec<(&str, bool)>, usize> = BTreeMap::new();
        dynamometer.iter().for_each(|read| *layouts.entry(used(read)).or_default() += 1);
        let usual: Vec<(&str, bool)> = layouts
            .into_iter()
            .max_by_key(|(_, count)| *count)
            .map(|(layout, _)| layout)
            .unwrap_or_else(|| used(first));
        let usual: Vec<(String, bool)> = usual.into_iter().map(|(name, is_used)| (name.to_owned(), is_used)).collect();
        let is_usual = |read: &Read| used(read).into_iter().eq(usual.iter().map(|(n, u)| (n.as_str(), *u)));
        let (dynamometer, odd): (Vec<Read>, Vec<Read>) = dynamometer.into_iter().partition(is_usual);
        if !odd.is_empty() {
            unknown.push(Note {
                what: format!(
                    "{} have other columns than the others and are left out: {}",
                    count(odd.len(), "file"),
                    some(folder, odd.iter().map(|r| &r.path))
                ),
                remedy: "make a study of their own of them, or export them with the same columns".to_owned(),
            });
        }
        let first = &dynamometer[0];
        let in_one_file = first.has_emg();
        let of_emg = if in_one_file { Some(first) } else { emg.first() };
        let of_emg = of_emg.ok_or_else(|| {
            let text = "no column of EMG was found whose name is that of a muscle of the model";
            let labels: Vec<&str> = first.columns.iter().map(|c| c.name.as_str()).take(12).collect();
            let hint =
                format!("columns found: {}; muscles of the model: {}", labels.join(", "), model_muscles.join(", "));
            Failure::from(Diagnostic::error(text).in_file(&first.path).hint(hint))
        })?;
        let (channels, kind) = channels(of_emg, &mut assumed, &mut unknown);
        let clock = match (in_one_file, of_emg.piece(&Role::MomentVoltage)) {
            (true, _) => Clock::Same,
            (false, Some(shared)) => Clock::Shared(shared.name),
            (false, None) => Clock::Trigger,
        };
        let mut recordings: Vec<Recording> = dynamometer.iter().map(|read| recording(folder, read, &people)).collect();
        if !in_one_file {
            pair(folder, &mut recordings, &emg, &mut unknown);
        }
        let emg_place = of_emg.columns.iter().position(|c| matches!(c.role, Role::Emg(_))).unwrap_or(0);
        let moment_place = first.columns.iter().position(|c| c.role == Role::Moment).unwrap_or(0);
        let need = |role: Role| {
            first.piece(&role).unwrap_or_else(|| Piece { name: String::new(), unit: None, sign: 1.0, offset: 0.0 })
        };
        let emg_columns: Vec<&str> = channels.iter().map(|(_, column)| column.as_str()).collect();
        let ignore = first.columns.iter().filter(|column| {
            matches!(column.role, Role::Other | Role::OtherEmg | Role::MomentVoltage)
                || matches!(column.role, Role::Emg(_)) && !emg_columns.contains(&column.name.as_str())
        });
        let mut names: Vec<String> = Vec::new();
        for column in ignore.chain(first.columns.iter().filter(|c| c.role == Role::Time).skip(1)) {
            if !names.contains(&column.name) {
                names.push(column.name.clone());
            }
        }
        let angles: Vec<&[f64]> = recordings.iter().map(|r| r.angle.as_slice()).collect();
        let angle = need(Role::Angle);
        let pieces = Pieces {
            time: need(Role::Time),
            is_radians: angle.unit.is_none() && columns::looks_like_radians(&angles),
            angle,
            velocity: first.piece(&Role::Velocity),
            moment: need(Role::Moment),
            muscles: channels.iter().map(|(muscle, _)| muscle.clone()).collect(),
            emg: channels,
            emg_kind: kind,
            ignore: names,
            clock,
            rates_hz: [first.rate_hz(moment_place), of_emg.rate_hz(emg_place)],
            has_mvc: false,
        };
        if pieces.is_radians {
            assumed.push(Note {
                what: format!("the angle `{}` is in radians", pieces.angle.name),
                remedy: "no unit is stated and it never exceeds 3.2; set unit = \"deg\" in [columns] angle if it is in degrees".to_owned(),
            });
        }
        if pieces.moment.unit.is_none() {
            unknown.push(Note {
                what: format!("the unit of the torque `{}`: it is taken as N·m", pieces.moment.name),
                remedy: "set unit = \"ft-lb\" (or another) in [columns] moment".to_owned(),
            });
        }
        if pieces.clock == Clock::Trigger {
            assumed.push(Note {
                what: "the recorders of torque and EMG were started by one trigger: their clocks begin together"
                    .to_owned(),
                remedy: "set delay_s in [emg_recorder], or shared and shared_with if a channel is in both files"
                    .to_owned(),
            });
        }
        let mut found =
            Found { folder: folder.to_owned(), recordings, people, pieces, assumed, unknown, understood: Vec::new() };
        found.describe(&dynamometer, of_emg);
        Ok(found)
    }

    /// Words of all paths, in lower case.
    pub fn words(&self) -> Vec<String> {
        let paths =
            self.recordings.iter().map(|r| within(&self.folder, &r.path)).chain([self.folder.display().to_string()]);
        let mut words: Vec<String> = paths
            .flat_map(|path| {
                path.to_lowercase().split(|c: char| !c.is_alphabetic()).map(str::to_owned).collect::<Vec<_>>()
            })
            .collect();
        words.sort();
        words.dedup();
        words
    }

    /// Whether names speak of flexion or extension.
    pub fn has_directions(&self) -> bool {
        self.recordings.iter().any(|r| r.named.direction.is_some())
    }

    /// Largest and least angle, as recorded.
    fn degrees(&self, angle: f64) -> f64 {
        let piece = &self.pieces.angle;
        let factor =
            if self.pieces.is_radians { 1f64.to_degrees() } else { piece.unit.map_or(1.0, |unit| unit.factor) };
        piece.sign * factor * angle + piece.offset
    }

    /// Sets sign and zero of the angle by the angles that names of isometric trials state.
    pub fn set_angles(&mut self, loaded: &LoadedModel, chosen: &Chosen) {
        let mean = |r: &Recording| self.degrees(r.angle.iter().sum::<f64>() / r.angle.len().max(1) as f64);
        let stated: Vec<(f64, f64)> = self
            .recordings
            .iter()
            .filter(|r| r.named.contraction != Some(Contraction::Passive))
            .filter_map(|r| Some((r.named.posture_deg?, mean(r))))
            .collect();
        let spread = |values: &[f64]| {
            let (low, high) =
                values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
            if values.is_empty() { 0.0 } else { high - low }
        };
        let fit = |sign: f64| {
            let mut offsets: Vec<f64> = stated.iter().map(|(named, mean)| named - sign * mean).collect();
            offsets.sort_by(f64::total_cmp);
            let middle = offsets.get(offsets.len() / 2).copied().unwrap_or(0.0);
            (spread(&offsets), middle)
        };
        let is_told = spread(&stated.iter().map(|s| s.0).collect::<Vec<_>>()) > 5.0;
        let [lower, upper] = loaded.model.coordinates[chosen.index.0].range.map(f64::to_degrees);
        if is_told {
            let (along, against) = (fit(1.0), fit(-1.0));
            let (sign, (left, offset)) = if against.0 < along.0 { (-1.0, against) } else { (1.0, along) };
            let offset = if offset.abs() < 5.0 { 0.0 } else { offset.round() };
            if left < 10.0 && (sign < 0.0 || offset != 0.0) {
                self.pieces.angle.sign = sign;
                self.pieces.angle.offset = offset;
                let turned = if sign < 0.0 { "the sign of the angle is turned" } else { "the angle keeps its sign" };
                self.assumed.push(Note {
                    what: format!(
                        "{turned}, and {offset}° are added to it: so it is the angle that the files' names state"
                    ),
                    remedy: "see sign and offset in [columns] angle".to_owned(),
                });
            }
        } else {
            self.unknown.push(Note {
                what: format!("the sign and the zero of the angle: it is taken as `{}` of the model", chosen.name),
                remedy: "compare the angles of a known posture; sign = -1 and offset in [columns] angle change them"
                    .to_owned(),
            });
        }
        let all: Vec<f64> = self.recordings.iter().flat_map(|r| r.angle.iter().map(|a| self.degrees(*a))).collect();
        let outside = all.iter().filter(|a| **a < lower - 12.0 || **a > upper + 12.0).count();
        if outside > 0 {
            self.unknown.push(Note {
                what: format!(
                    "{} % of the angles are outside of the range of `{}`, {lower:.0}° to {upper:.0}°",
                    fixed(100.0 * outside as f64 / all.len() as f64, 0),
                    chosen.name
                ),
                remedy: "set offset and sign in [columns] angle, or --coordinate NAME".to_owned(),
            });
        }
    }

    /// The trials with what each is for.
    pub fn trials(&mut self) -> Vec<ProposedTrial> {
        let largest = |r: &Recording| r.moment.iter().fold(0.0, |a: f64, m| a.max(m.abs()));
        let most = self.recordings.iter().map(largest).fold(0.0, f64::max);
        let mut guessed = 0;
        let mut trials: Vec<ProposedTrial> = Vec::new();
        for r in &self.recordings {
            let angles: Vec<f64> = r.angle.iter().map(|a| self.degrees(*a)).collect();
            let travel = angles.iter().copied().fold(f64::NEG_INFINITY, f64::max)
                - angles.iter().copied().fold(f64::INFINITY, f64::min);
            let contraction = r.named.contraction.unwrap_or_else(|| {
                guessed += 1;
                match (travel > MOVES_DEG, largest(r) < RELAXED_PART * most) {
                    (true, true) => Contraction::Passive,
                    (true, false) => Contraction::Isotonic,
                    (false, _) => Contraction::Isometric,
                }
            });
            let direction = match contraction {
                Contraction::Passive => Direction::None,
                _ => r.named.direction.unwrap_or(Direction::None),
            };
            let posture = r.named.posture_deg.filter(|_| contraction == Contraction::Isometric);
            trials.push(ProposedTrial {
                participant: r.participant.clone(),
                file: within(&self.folder, &r.path),
                emg_file: r.emg.as_ref().map(|path| within(&self.folder, path)),
                contraction: contraction.word().to_owned(),
                effort_percent: r.named.effort_percent.or((contraction == Contraction::Mvc).then_some(100.0)),
                direction: direction.word().to_owned(),
                posture_deg: posture,
                repetition: r.named.repetition,
                usage: if contraction == Contraction::Mvc { "mvc" } else { "train" }.to_owned(),
            });
        }
        if guessed > 0 {
            self.assumed.push(Note {
                what: format!("what {} is, by its motion and moment alone", count(guessed, "trial")),
                remedy: "see contraction, direction and effort_percent in trials.csv".to_owned(),
            });
        }
        let undirected = trials.iter().filter(|t| t.direction == "none" && t.contraction != "passive").count();
        if undirected > 0 {
            self.unknown.push(Note {
                what: format!("the direction of the effort in {}", count(undirected, "trial")),
                remedy: "enter flexion or extension in the column direction of trials.csv; signs are checked by it"
                    .to_owned(),
            });
        }
        self.hold_out(&mut trials);
        self.find_mvc(&mut trials);
        trials
    }

    /// The last repetition of every condition is held out; without repetitions, every fifth trial.
    fn hold_out(&mut self, trials: &mut [ProposedTrial]) {
        let key = |t: &ProposedTrial| {
            let number = |v: Option<f64>| v.map(|v| v.to_string());
            (
                t.participant.clone(),
                t.contraction.clone(),
                t.direction.clone(),
                number(t.effort_percent),
                number(t.posture_deg),
            )
        };
        let mut groups: BTreeMap<_, Vec<usize>> = BTreeMap::new();
        for (i, trial) in trials.iter().enumerate().filter(|(_, t)| t.usage == "train") {
            groups.entry(key(trial)).or_default().push(i);
        }
        let repeated: Vec<usize> = groups.values().filter(|g| g.len() > 1).filter_map(|g| g.last().copied()).collect();
        let (held, how) = if repeated.is_empty() {
            let trained: Vec<usize> = groups.values().flatten().copied().collect();
            let fifth = trained.iter().skip(2).step_by(5).copied().collect::<Vec<_>>();
            (if trained.len() >= 5 { fifth } else { Vec::new() }, "every fifth trial, as no condition was repeated")
        } else {
            (repeated, "the last repetition of every repeated condition")
        };
        if !held.is_empty() {
            self.assumed.push(Note {
                what: format!("held out for the judgement of the fit: {how} ({})", count(held.len(), "trial")),
                remedy: "see the column use of trials.csv".to_owned(),
            });
        }
        held.into_iter().for_each(|i| trials[i].usage = "test".to_owned());
    }

    /// Raw EMG needs maximum contractions: without named ones, the strongest trials of each direction are taken.
    fn find_mvc(&mut self, trials: &mut [ProposedTrial]) {
        let mut participants: Vec<String> = trials.iter().map(|t| t.participant.clone()).collect();
        participants.dedup();
        for participant in participants {
            let of = |t: &ProposedTrial| t.participant == participant;
            if trials.iter().any(|t| of(t) && t.usage == "mvc") || self.pieces.emg_kind != EmgKind::Raw {
                continue;
            }
            for direction in ["flexion", "extension", "none"] {
                let strongest = (0..trials.len())
                    .filter(|i| {
                        of(&trials[*i]) && trials[*i].direction == direction && trials[*i].contraction != "passive"
                    })
                    .max_by(|a, b| {
                        let most = |i: usize| self.recordings[i].moment.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
                        most(*a).total_cmp(&most(*b))
                    });
                if let Some(i) = strongest {
                    trials[i].usage = "mvc".to_owned();
                    self.assumed.push(Note {
                        what: format!(
                            "{} is the maximum contraction of {participant} that EMG is normalized by",
                            trials[i].file
                        ),
                        remedy: "no name of a file says MVC; the strongest trial is taken: see use in trials.csv"
                            .to_owned(),
                    });
                }
            }
        }
        self.pieces.has_mvc = trials.iter().any(|t| t.usage == "mvc");
    }

    /// The participants, with what a table of anthropometry says of them.
    pub fn people(&mut self) -> Vec<Participant> {
        let mut names: Vec<&String> = self.recordings.iter().map(|r| &r.participant).collect();
        names.dedup();
        let mut people: Vec<Participant> = Vec::new();
        let mut without: Vec<&str> = Vec::new();
        for name in names {
            if people.iter().any(|p| p.name == *name) {
                continue;
            }
            let known = self.people.iter().find(|p| p.name.eq_ignore_ascii_case(name));
            if known.is_none() {
                without.push(name);
            }
            people.push(
                known.map_or_else(|| Participant::named(name), |p| Participant { name: name.clone(), ..p.clone() }),
            );
        }
        if !without.is_empty() {
            self.unknown.push(Note {
                what: format!("mass, height, sex and side of {}", without.join(", ")),
                remedy: "enter them in participants.csv; scaling needs them, a fit does not".to_owned(),
            });
        }
        people
    }

    fn describe(&mut self, dynamometer: &[Read], emg: &Read) {
        let layout = |read: &Read| {
            let d = &read.exported.dialect;
            let mut text = format!("columns separated by {}", d.separator.word());
            if d.decimal_comma {
                text.push_str(", decimal commas");
            }
            if d.header_line > 1 {
                text.push_str(&format!(", names on line {}", d.header_line));
            }
            if d.units_line.is_some() {
                text.push_str(", units below them");
            }
            text
        };
        let [rate, emg_rate] = self.pieces.rates_hz.map(|rate| fixed(rate, 0));
        let mut lines = vec![(
            "dynamometer",
            format!("{}, {rate} Hz; {}", count(dynamometer.len(), "file"), layout(&dynamometer[0])),
        )];
        match self.pieces.clock {
            Clock::Same => lines.push(("EMG", format!("in the same files, {emg_rate} Hz"))),
            _ => lines.push(("EMG", format!("files of its own, {emg_rate} Hz; {}", layout(emg)))),
        }
        self.understood.extend(lines.into_iter().map(|(what, text)| (what.to_owned(), text)));
    }

    /// What was understood, line by line.
    pub fn understood(&self, loaded: &LoadedModel, draft: &Draft) -> Vec<(String, String)> {
        let mut lines = self.understood.clone();
        let pieces = &draft.pieces;
        let of = |piece: &Piece| {
            let unit = piece.unit.map_or(String::new(), |unit| format!(" [{}]", unit.symbol));
            format!("`{}`{unit}", piece.name)
        };
        let mut own = vec![format!("time {}", of(&pieces.time)), format!("angle {}", of(&pieces.angle))];
        own.extend(pieces.velocity.iter().filter(|_| draft.velocity_used).map(|v| format!("speed {}", of(v))));
        let turned = if draft.moment_sign < 0.0 { ", sign turned" } else { "" };
        own.push(format!("moment {}{turned}", of(&pieces.moment)));
        lines.push(("columns".to_owned(), own.join(", ")));
        let channels: Vec<String> =
            pieces.emg.iter().map(|(muscle, column)| format!("{muscle} ← `{column}`")).collect();
        let kind = match pieces.emg_kind {
            EmgKind::Raw => "raw",
            EmgKind::Normalized => "envelopes, parts of the maximum",
            EmgKind::Percent => "envelopes in percent of the maximum",
        };
        lines.push(("muscles".to_owned(), format!("{} ({kind})", channels.join(", "))));
        let posture =
            draft.posture.iter().map(|held| format!("{} {:.0}°", held.name, held.value_deg)).collect::<Vec<_>>();
        let at = if posture.is_empty() { String::new() } else { format!("; held: {}", posture.join(", ")) };
        lines.push((
            "model".to_owned(),
            format!("{}: the dynamometer moves `{}`{at}", loaded.model.name, draft.coordinate),
        ));
        let of_use = |usage: &str| draft.trials.iter().filter(|t| t.usage == usage).count();
        let trials = format!(
            "{} of {}: {} to fit, {} held out, {} maximum contractions",
            count(draft.trials.len(), "trial"),
            count(draft.people.len(), "participant"),
            of_use("train"),
            of_use("test"),
            of_use("mvc")
        );
        lines.push(("trials".to_owned(), trials));
        lines
    }
}

/// Columns that the study uses, and the names of the others.
fn used(read: &Read) -> Vec<(&str, bool)> {
    read.layout()
}

fn recording(folder: &Path, read: &Read, people: &[Participant]) -> Recording {
    let path = within(folder, &read.path);
    let stem = read.path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let participant = participant(folder, &path, &stem, people);
    let mut named = conditions::of_name(&stem);
    // Folders say what names leave out, the nearest first.
    let parents: Vec<&str> = path.split('/').rev().skip(1).collect();
    for parent in parents {
        let of_folder = conditions::of_name(parent);
        named.contraction = named.contraction.or(of_folder.contraction);
        named.direction = named.direction.or(of_folder.direction);
        named.effort_percent = named.effort_percent.or(of_folder.effort_percent);
    }
    Recording {
        participant,
        named,
        emg: None,
        angle: read.samples(&Role::Angle),
        moment: read.samples(&Role::Moment),
        path: read.path.clone(),
    }
}

/// Who a file is of: a folder or the beginning of the name that is a participant's, or the first folder that tells
/// participants of the table.
fn participant(folder: &Path, path: &str, stem: &str, people: &[Participant]) -> String {
    let parts: Vec<&str> = path.split('/').collect();
    let of_table = |part: &&str| people.iter().find(|p| part.to_lowercase().starts_with(&p.name.to_lowercase()));
    if let Some(known) = parts.iter().find_map(of_table) {
        return known.name.clone();
    }
    let whole = |part: &&str| conditions::participant(part);
    let folders = parts.iter().take(parts.len().saturating_sub(1)).find_map(whole);
    let of_root = || conditions::participant(&folder.file_name().unwrap_or_default().to_string_lossy());
    folders.or_else(|| conditions::participant(stem)).or_else(of_root).unwrap_or_else(|| "P01".to_owned())
}

/// Finds the file of the EMG of every recording.
fn pair(folder: &Path, recordings: &mut Vec<Recording>, emg: &[Read], unknown: &mut Vec<Note>) {
    let key = |path: &Path| {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().to_lowercase();
        let start = conditions::participant(&stem).map_or(0, |p| p.len());
        let words = stem[start..].split(|c: char| !(c.is_alphanumeric() || matches!(c, '+' | '-' | '%' | '.')));
        words
            .filter(|word| !word.is_empty() && !RECORDERS.contains(word))
            .map(str::to_owned)
            .collect::<Vec<_>>()
            .join(" ")
    };
    let of = |path: &Path| {
        let shown = within(folder, path);
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        participant(folder, &shown, &stem, &[])
    };
    let candidates: Vec<(String, String, &PathBuf)> =
        emg.iter().map(|r| (of(&r.path), key(&r.path), &r.path)).collect();
    for recording in recordings.iter_mut() {
        let (who, name) = (of(&recording.path), key(&recording.path));
        let own: Vec<&(String, String, &PathBuf)> = candidates.iter().filter(|c| c.0 == who).collect();
        let exact = own.iter().find(|c| c.1 == name);
        let near = || {
            let found = nearest(&name, own.iter().map(|c| c.1.as_str()))?;
            own.iter().find(|c| c.1 == found && !same_numbers(&c.1, &name).is_none_or(|same| !same))
        };
        recording.emg = exact.or_else(near).map(|c| c.2.clone());
    }
    let without: Vec<&PathBuf> = recordings.iter().filter(|r| r.emg.is_none()).map(|r| &r.path).collect();
    if !without.is_empty() {
        unknown.push(Note {
            what: format!(
                "{} without a file of EMG are left out: {}",
                count(without.len(), "recording"),
                some(folder, without.into_iter())
            ),
            remedy: "files belong together whose names agree but for the recorder (emg, delsys, biodex, …)".to_owned(),
        });
        recordings.retain(|r| r.emg.is_some());
    }
    let alone: Vec<&PathBuf> =
        emg.iter().map(|r| &r.path).filter(|path| !recordings.iter().any(|r| r.emg.as_ref() == Some(path))).collect();
    if !alone.is_empty() {
        unknown.push(Note {
            what: format!(
                "{} of EMG without a recording of the torque: {}",
                count(alone.len(), "file"),
                some(folder, alone.into_iter())
            ),
            remedy: "they are not used".to_owned(),
        });
    }
}

/// Whether two names have the same numbers.
fn same_numbers(a: &str, b: &str) -> Option<bool> {
    let numbers = |text: &str| {
        let parts = text.split(|c: char| !c.is_ascii_digit()).filter(|p| !p.is_empty());
        parts.map(str::to_owned).collect::<Vec<_>>()
    };
    Some(numbers(a) == numbers(b))
}

/// Muscles and columns of EMG, and how it was recorded.
fn channels(read: &Read, assumed: &mut Vec<Note>, unknown: &mut Vec<Note>) -> (Vec<(String, String)>, EmgKind) {
    let mut found: Vec<(String, String)> = Vec::new();
    let mut kinds: Vec<EmgKind> = Vec::new();
    let mut sides: Vec<&str> = Vec::new();
    for (i, column) in read.columns.iter().enumerate() {
        let Role::Emg(muscles) = &column.role else { continue };
        if muscles.len() > 1 || !column.is_exact {
            assumed.push(Note {
                what: format!("`{}` is the EMG of {}", column.name, muscles.join(" and ")),
                remedy: "see [columns] emg in study.toml".to_owned(),
            });
        }
        sides.extend(muscles::side(&column.name));
        for muscle in muscles {
            match found.iter().find(|(known, _)| known == muscle) {
                Some((_, first)) => unknown.push(Note {
                    what: format!("`{}` and `{first}` are both of {muscle}: the first is taken", column.name),
                    remedy: "see [columns] emg in study.toml".to_owned(),
                }),
                None => found.push((muscle.clone(), column.name.clone())),
            }
        }
        kinds.extend(columns::emg_kind(&read.exported.columns[i], column.unit));
    }
    sides.sort_unstable();
    sides.dedup();
    if sides.len() > 1 {
        unknown.push(Note {
            what: "labels of EMG name both sides".to_owned(),
            remedy: "a study has one arm a participant: see [columns] emg in study.toml".to_owned(),
        });
    }
    let others: Vec<&str> =
        read.columns.iter().filter(|c| c.role == Role::OtherEmg).map(|c| c.name.as_str()).take(8).collect();
    if !others.is_empty() {
        unknown.push(Note {
            what: format!("which muscle of the model these are of, if any: {}", others.join(", ")),
            remedy: "add the muscle to [muscles] active and the column to [columns] emg".to_owned(),
        });
    }
    // Raw channels show it most clearly; all are of one recorder.
    let kind = kinds.iter().find(|k| **k == EmgKind::Raw).or(kinds.first()).copied().unwrap_or_else(|| {
        unknown.push(Note {
            what: "whether the EMG is raw or an envelope: it is taken as raw".to_owned(),
            remedy: "set kind in [emg]; envelopes must be parts of the maximum, 0 to 1".to_owned(),
        });
        EmgKind::Raw
    });
    (found, kind)
}

fn note_left(folder: &Path, left: &[PathBuf], unknown: &mut Vec<Note>) {
    if !left.is_empty() {
        unknown.push(Note {
            what: format!("what {} hold: {}", count(left.len(), "other file"), some(folder, left.iter())),
            remedy: "they are not used; carpus reads text (.csv, .txt, .tsv): C3D by carpus c3d, .mat and .xlsx exported as CSV".to_owned(),
        });
    }
}

/// Files of text below a folder, in the order of their names, and other files.
fn files(folder: &Path) -> Result<(Vec<PathBuf>, Vec<PathBuf>), Failure> {
    let (mut text, mut others, mut folders) = (Vec::new(), Vec::new(), vec![folder.to_owned()]);
    while let Some(next) = folders.pop() {
        let unreadable =
            |e: std::io::Error| Failure::from(Diagnostic::error(format!("cannot be read: {e}")).in_file(&next));
        for entry in std::fs::read_dir(&next).map_err(unreadable)? {
            let path = entry.map_err(unreadable)?.path();
            let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
            let is_own = matches!(name.as_str(), "study.toml" | "participants.csv" | "trials.csv");
            if name.starts_with('.') || path.is_symlink() || (is_own && next.join("study.toml").exists()) {
                continue;
            }
            let end = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
            match path.is_dir() {
                true => folders.push(path),
                false if TEXT_FILES.contains(&end.as_str()) => text.push(path),
                false => others.push(path),
            }
        }
        if text.len() > MOST_FILES {
            let message = Diagnostic::error(format!("more than {MOST_FILES} files")).in_file(folder);
            return Err(message.hint("give the folder of one study").into());
        }
    }
    let natural = |path: &PathBuf| natural_order(&path.display().to_string());
    text.sort_by_key(natural);
    others.sort();
    Ok((text, others))
}

/// A name such that numbers in it are in their order.
fn natural_order(name: &str) -> Vec<(String, u64)> {
    let mut parts = Vec::new();
    let (mut letters, mut digits) = (String::new(), String::new());
    for c in name.chars() {
        if c.is_ascii_digit() && digits.len() < 18 {
            digits.push(c);
        } else {
            if !digits.is_empty() {
                parts.push((std::mem::take(&mut letters), digits.parse().unwrap_or(0)));
                digits.clear();
            }
            letters.push(c);
        }
    }
    parts.push((letters, digits.parse().unwrap_or(0)));
    parts
}

/// The path below a folder, with slashes.
fn within(folder: &Path, path: &Path) -> String {
    let parts = path.strip_prefix(folder).unwrap_or(path).components();
    parts.map(|part| part.as_os_str().to_string_lossy().into_owned()).collect::<Vec<_>>().join("/")
}

fn count(n: usize, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

fn some<'p>(folder: &Path, paths: impl ExactSizeIterator<Item = &'p PathBuf>) -> String {
    let n = paths.len();
    let mut names: Vec<String> = paths.take(3).map(|path| within(folder, path)).collect();
    if n > names.len() {
        names.push(format!("… ({} more)", n - names.len()));
    }
    names.join(", ")
}
