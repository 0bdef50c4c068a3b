//! The files of a folder: which are recordings of what, and which columns a study of them has.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::columns::{self, EmgKind, Role};
use super::draft::Draft;
use super::folder::{count, files, may_be_table, note_left, some, within};
use super::piece::{Clock, Piece, Pieces};
use super::proposal::Note;
use super::read_file::Read;
use super::recordings::{Recording, pair, recording};
use super::whose::Whose;
use super::{muscles, people};
use crate::account::fixed;
use crate::diagnostic::{Diagnostic, Failure};
use crate::model::LoadedModel;
use carpus_study::study::{Exported, Format, Participant, StudyErrors};

/// What was found in a folder.
pub struct Found {
    /// The folder.
    pub folder: PathBuf,
    /// The recordings.
    pub recordings: Vec<Recording>,
    /// Whom a table of anthropometry has.
    pub people: Vec<Participant>,
    /// The columns.
    pub pieces: Pieces,
    /// What was assumed.
    pub assumed: Vec<Note>,
    /// What could not be told.
    pub unknown: Vec<Note>,
    understood: Vec<(String, String)>,
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
        let looked: Vec<(PathBuf, Result<Vec<Read>, StudyErrors>)> = files
            .into_par_iter()
            .map(|path| {
                let with_columns = |exported: Exported| {
                    let columns = columns::columns(&exported, &model_muscles);
                    Read { path: path.clone(), exported, columns }
                };
                let read = Exported::read(&path).map(|tables| tables.into_iter().map(with_columns).collect());
                (path, read)
            })
            .collect();
        let mut people = Vec::new();
        let (mut dynamometer, mut emg, mut left): (Vec<Read>, Vec<Read>, Vec<PathBuf>) = Default::default();
        for (path, found) in looked {
            let is_text = may_be_table(&path).1;
            let mut is_used = false;
            match found {
                Ok(tables) => {
                    for read in tables {
                        let is_of_dynamometer =
                            read.has(&Role::Moment) && read.has(&Role::Angle) && read.has(&Role::Time);
                        is_used |= is_of_dynamometer || read.has_emg();
                        match () {
                            () if is_of_dynamometer => dynamometer.push(read),
                            () if read.has_emg() => emg.push(read),
                            () => {}
                        }
                    }
                }
                // Why a file that is no text cannot be read is worth telling: it holds nothing but recordings.
                Err(errors) if !is_text => {
                    unknown.extend(errors.errors.iter().map(|problem| Note {
                        what: format!("what {} holds: {}", within(folder, &path), problem.fault),
                        remedy: problem.hint().unwrap_or_default(),
                    }));
                    is_used = true;
                }
                Err(_) => {}
            }
            if !is_used {
                match people::read(&path).filter(|_| is_text) {
                    Some(found) => people.extend(found),
                    None => left.push(path),
                }
            }
        }
        left.extend(others);
        note_left(folder, &left, &mut unknown);
        let first = dynamometer.first().ok_or_else(|| {
            let text = "no file with a time, an angle and a torque was found";
            let hint = "columns are known by names such as Time, Position or Angle, \
                        Torque or Moment, and by their units; \
                        text (.csv, .txt, .tsv), .xlsx, .mat, .edf, .bdf, .c3d, .sto and .mot are read";
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
        let paths = dynamometer.iter().chain(&emg).map(|read| read.path.as_path());
        let whose = Whose::new(folder, &people, paths, [&mut assumed, &mut unknown]);
        let mut recordings: Vec<Recording> = dynamometer.iter().map(|read| recording(folder, read, &whose)).collect();
        if !in_one_file {
            pair(folder, &mut recordings, &emg, &whose, &mut unknown);
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
                remedy: "no unit is stated and it never exceeds 3.2; \
                         set unit = \"deg\" in [columns] angle if it is in degrees"
                    .to_owned(),
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

    fn describe(&mut self, dynamometer: &[Read], emg: &Read) {
        let layout = |read: &Read| {
            let d = &read.exported.dialect;
            if read.exported.format != Format::Text {
                let which =
                    read.table().map(|table| format!(" ({}s such as `{table}`)", read.exported.format.table_word()));
                return format!("{}{}", read.exported.format.words(), which.unwrap_or_default());
            }
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
