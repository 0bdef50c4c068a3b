//! What each trial is and is for, by its name and its signals; the zero of the angle; the participants.

use std::collections::BTreeMap;

use super::columns::EmgKind;
use super::coordinate::Chosen;
use super::folder::{count, within};
use super::pieces::Found;
use super::proposal::{Note, ProposedTrial};
use super::recordings::Recording;
use crate::account::fixed;
use crate::model::LoadedModel;
use carpus_study::study::{Contraction, Direction, Participant};

/// Travel from which on a joint moves [deg].
const MOVES_DEG: f64 = 6.0;
/// A joint that is moved with less than this part of the largest moment is relaxed.
const RELAXED_PART: f64 = 0.15;

impl Found {
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
                emg_file: r.emg.as_ref().map(|(path, _)| within(&self.folder, path)),
                table: r.table.clone(),
                emg_table: r.emg.as_ref().and_then(|(_, table)| table.clone()),
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
}
