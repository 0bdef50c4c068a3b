//! What the page asks for, as words of a command.

use serde::Deserialize;

use carpus_session::diagnostic::{Diagnostic, Failure};
use carpus_session::provenance::{DEFAULT_SEED, command_line};

use crate::ledger::{Ledger, Outcome, Step, StepModel};
use crate::settings::Settings;

/// A command with what a person chose. Each option belongs to some of the commands.
#[derive(Clone, Debug, Deserialize, PartialEq, Eq)]
#[serde(deny_unknown_fields)]
pub(crate) struct Asked {
    /// The command.
    pub command: Command,
    /// Only these participants; none: all.
    #[serde(default)]
    pub participants: Vec<String>,
    /// Whether the current step's model is read instead of the study's.
    #[serde(default)]
    pub from_current: bool,
    /// `personalize`: no intervals.
    #[serde(default)]
    pub no_intervals: bool,
    /// `effect add`: the effects, in this order. `plan`: those to tell apart.
    #[serde(default)]
    pub effects: Vec<String>,
    /// `effect add`: although the diagnosis does not support them.
    #[serde(default)]
    pub i_choose: bool,
    /// `effect remove`: the step of the participant's ledger to go to; without it one back.
    #[serde(default)]
    pub to: Option<usize>,
    /// `study`: only these steps.
    #[serde(default)]
    pub steps: Vec<String>,
}

/// The commands that are steps.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Command {
    /// `carpus compare`
    Compare,
    /// `carpus personalize`
    Personalize,
    /// `carpus diagnose`
    Diagnose,
    /// `carpus effect add`
    EffectAdd,
    /// `carpus effect remove`
    EffectRemove,
    /// `carpus plan`
    Plan,
    /// `carpus study`
    Study,
}

impl Command {
    /// Its words.
    fn words(self) -> &'static [&'static str] {
        match self {
            Command::Compare => &["compare"],
            Command::Personalize => &["personalize"],
            Command::Diagnose => &["diagnose"],
            Command::EffectAdd => &["effect", "add"],
            Command::EffectRemove => &["effect", "remove"],
            Command::Plan => &["plan"],
            Command::Study => &["study"],
        }
    }
}

/// A step that can be begun.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Planned {
    /// The step, as it is entered into the ledger.
    pub step: Step,
    /// Arguments of the program.
    pub words: Vec<String>,
}

impl Asked {
    /// The step that this is on top of the current one.
    ///
    /// - `participants`: of the study
    /// - `own_effects`: files of effects that the study names
    ///
    /// # Errors
    /// Options that the command does not have, or that do not fit the study or the current step.
    pub fn planned(
        &self,
        settings: &Settings,
        ledger: &Ledger,
        participants: &[String],
        own_effects: &[String],
    ) -> Result<Planned, Failure> {
        self.refuse_foreign_options()?;
        if let Some(unknown) = self.participants.iter().find(|name| !participants.contains(name)) {
            return Err(error(format!("there is no participant `{unknown}`")));
        }
        for name in self.effects.iter().chain(&self.steps) {
            let is_plain = |c: char| c.is_ascii_alphanumeric() || c == '_';
            if name.is_empty() || !name.chars().all(is_plain) {
                return Err(error(format!("expected a name of letters, digits and _, found `{name}`")));
            }
        }
        let id = ledger.steps.len() + 1;
        let folder = format!("{id:02}-{}", self.command.words().join("-"));
        let now = ledger.now();
        let (words, reads, copy_of) = match self.command {
            Command::EffectRemove => self.removal(settings, now, &folder, own_effects)?,
            _ => self.work(settings, ledger, &folder)?,
        };
        let mut commands = Vec::new();
        if let Some(copied) = copy_of.and_then(|id| ledger.step(id)) {
            let quoted = |inside: &str| {
                Ok::<_, Failure>(command_line([settings.out_word(inside)?])["carpus ".len()..].to_owned())
            };
            commands.push(format!("cp -r {} {}", quoted(&copied.folder)?, quoted(&folder)?));
        }
        commands.push(command_line(words.clone()));
        let step = Step {
            id,
            parent: ledger.current,
            label: self.label(),
            writer: self.command.words()[0].to_owned(),
            reads,
            copy_of,
            run_in: std::env::current_dir().map(|folder| folder.display().to_string()).unwrap_or_default(),
            commands,
            folder,
            outcome: Outcome::Running,
            models: now.map(|step| step.models.clone()).unwrap_or_default(),
            ..Step::default()
        };
        Ok(Planned { step, words })
    }

    /// Words of a command about the study.
    fn work(
        &self,
        settings: &Settings,
        ledger: &Ledger,
        folder: &str,
    ) -> Result<(Vec<String>, Vec<String>, Option<usize>), Failure> {
        let reads = self.reads(settings, ledger.now())?;
        let mut words: Vec<String> = self.command.words().iter().map(ToString::to_string).collect();
        words.push(settings.study_word()?);
        if self.command == Command::EffectAdd {
            if self.effects.is_empty() {
                return Err(error("expected at least one effect to add"));
            }
            words.push(self.effects.join(","));
        }
        words.extend(reads.iter().cloned());
        words.extend(["--out".to_owned(), settings.out_word(folder)?]);
        if self.no_intervals {
            words.push("--no-intervals".to_owned());
        }
        if self.i_choose {
            words.push("--i-choose".to_owned());
        }
        if self.command == Command::Plan && !self.effects.is_empty() {
            words.extend(["--candidates".to_owned(), self.effects.join(",")]);
        }
        if !self.steps.is_empty() {
            words.extend(["--steps".to_owned(), self.steps.join(",")]);
        }
        if settings.allow_unsupported {
            words.push("--allow-unsupported".to_owned());
        }
        if settings.seed != DEFAULT_SEED {
            words.extend(["--seed".to_owned(), settings.seed.to_string()]);
        }
        let copy_of = match self.command {
            // They go on with the diagnosis that lies in the folder.
            Command::EffectAdd | Command::Plan => ledger.now().filter(|step| goes_on(step, &reads)).map(|step| step.id),
            // Units that a run had finished when it was stopped are found again.
            Command::Study => {
                let last = ledger.steps.iter().rfind(|step| step.writer == "study");
                last.filter(|step| step.outcome == Outcome::Cancelled && step.reads == reads).map(|step| step.id)
            }
            _ => None,
        };
        Ok((words, reads, copy_of))
    }

    /// Which model and participants are read.
    fn reads(&self, settings: &Settings, now: Option<&Step>) -> Result<Vec<String>, Failure> {
        let mut words = Vec::new();
        for name in &self.participants {
            match name.starts_with('-') {
                true => words.push(format!("--participant={name}")),
                false => words.extend(["--participant".to_owned(), name.clone()]),
            }
        }
        if !self.from_current {
            return Ok(words);
        }
        let [participant] = self.participants.as_slice() else {
            return Err(error("a step's model is one participant's: choose one participant"));
        };
        let model = now.and_then(|step| step.models.get(participant));
        let StepModel { model, effects } =
            model.ok_or_else(|| error(format!("the current step has no model of {participant}")))?;
        words.extend(["--model".to_owned(), settings.out_word(model)?]);
        if let Some(effects) = effects {
            if self.command == Command::Personalize {
                let text = "this model has effects beside its file, which `carpus personalize` does not read";
                return Err(error(text));
            }
            words.extend(["--effects".to_owned(), settings.out_word(effects)?]);
        }
        Ok(words)
    }

    /// Words that take a step back in the ledger of effects of one participant.
    fn removal(
        &self,
        settings: &Settings,
        now: Option<&Step>,
        folder: &str,
        own_effects: &[String],
    ) -> Result<(Vec<String>, Vec<String>, Option<usize>), Failure> {
        let [participant] = self.participants.as_slice() else {
            return Err(error("effects are removed from one participant's model: choose one participant"));
        };
        let of_participant = |step: &&Step| {
            let ledger = settings.out.join(&step.folder).join(participant).join("ledger.json");
            step.outcome.has_results() && ledger.is_file()
        };
        let step = now
            .filter(of_participant)
            .ok_or_else(|| error(format!("the current step added no effects to the model of {participant}")))?;
        let mut words = vec!["effect".to_owned(), "remove".to_owned()];
        words.push(settings.out_word(&format!("{folder}/{participant}"))?);
        if let Some(to) = self.to {
            words.extend(["--to".to_owned(), to.to_string()]);
        }
        for file in own_effects {
            words.extend(["--own-effect".to_owned(), file.clone()]);
        }
        Ok((words, step.reads.clone(), Some(step.id)))
    }

    /// The command and what was chosen, in a few words.
    fn label(&self) -> String {
        let mut label = self.command.words().join(" ");
        for chosen in [&self.effects, &self.steps].into_iter().filter(|names| !names.is_empty()) {
            label.push_str(&format!(" {}", chosen.join(", ")));
        }
        if let Some(to) = self.to {
            label.push_str(&format!(" to step {to}"));
        }
        if !self.participants.is_empty() {
            label.push_str(&format!(", {}", self.participants.join(", ")));
        }
        if self.from_current {
            label.push_str(", on the step's model");
        }
        label
    }

    /// Fails where an option was chosen that the command does not have.
    fn refuse_foreign_options(&self) -> Result<(), Failure> {
        let Asked { command, no_intervals, effects, i_choose, to, steps, from_current, .. } = self;
        let options = [
            ("no_intervals", *no_intervals, matches!(command, Command::Personalize)),
            ("effects", !effects.is_empty(), matches!(command, Command::EffectAdd | Command::Plan)),
            ("i_choose", *i_choose, matches!(command, Command::EffectAdd)),
            ("to", to.is_some(), matches!(command, Command::EffectRemove)),
            ("steps", !steps.is_empty(), matches!(command, Command::Study)),
            ("from_current", *from_current, !matches!(command, Command::EffectRemove | Command::Study)),
        ];
        match options.into_iter().find(|(_, is_chosen, has)| *is_chosen && !has) {
            Some((name, ..)) => Err(error(format!("carpus {} has no option `{name}`", command.words().join(" ")))),
            None => Ok(()),
        }
    }
}

/// Whether a command that goes on with a diagnosis goes on in the folder of a step: that of a diagnosis, a plan or
/// effects, of the same model and participants.
fn goes_on(step: &Step, reads: &[String]) -> bool {
    step.outcome.has_results() && ["diagnose", "effect", "plan"].contains(&step.writer.as_str()) && step.reads == reads
}

fn error(text: impl Into<String>) -> Failure {
    Diagnostic::error(text).into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Program;

    fn settings() -> Settings {
        Settings {
            study: "my study".into(),
            out: "out".into(),
            port: 0,
            seed: DEFAULT_SEED,
            allow_unsupported: false,
            program: Program { file: "carpus".into(), threads: None },
        }
    }

    fn ledger(steps: Vec<Step>) -> Ledger {
        let current = steps.len();
        Ledger { schema: String::new(), study: String::new(), study_file: String::new(), current, steps }
    }

    fn planned(text: &str, steps: Vec<Step>) -> Result<Planned, String> {
        let asked: Asked = serde_json::from_str(text).map_err(|e| e.to_string())?;
        let participants = ["P01".to_owned(), "P02".to_owned()];
        asked.planned(&settings(), &ledger(steps), &participants, &[]).map_err(|e| e.to_string())
    }

    fn diagnosed() -> Step {
        let models = [("P01", None), ("P02", Some("01-effect-add/P02/effects.toml".to_owned()))];
        let models = models.map(|(name, effects)| {
            (name.to_owned(), StepModel { model: format!("01-effect-add/{name}/model.osim"), effects })
        });
        Step {
            id: 1,
            writer: "effect".to_owned(),
            folder: "01-effect-add".to_owned(),
            outcome: Outcome::Done,
            models: models.into(),
            ..Step::default()
        }
    }

    #[test]
    fn verif_a_step_is_the_command_that_gives_its_folder() {
        let first = planned(r#"{"command": "personalize", "no_intervals": true}"#, Vec::new()).unwrap();
        assert_eq!(first.step.commands, ["carpus personalize 'my study' --out out/01-personalize --no-intervals"]);
        let text = r#"{"command": "diagnose", "participants": ["P02"], "from_current": true}"#;
        let second = planned(text, vec![diagnosed()]).unwrap();
        assert_eq!(
            second.step.commands,
            ["carpus diagnose 'my study' --participant P02 --model out/01-effect-add/P02/model.osim --effects \
              out/01-effect-add/P02/effects.toml --out out/02-diagnose"]
        );
        assert_eq!((second.step.parent, second.step.copy_of), (1, None));
    }

    #[test]
    fn verif_what_goes_on_with_a_diagnosis_goes_on_in_a_copy() {
        let text = r#"{"command": "effect_add", "effects": ["gravity", "joint_stiffness"], "i_choose": true}"#;
        let added = planned(text, vec![diagnosed()]).unwrap();
        assert_eq!(
            added.step.commands,
            [
                "cp -r out/01-effect-add out/02-effect-add",
                "carpus effect add 'my study' gravity,joint_stiffness --out out/02-effect-add --i-choose"
            ]
        );
        // Of other participants it is another diagnosis.
        let text = r#"{"command": "plan", "participants": ["P01"]}"#;
        assert_eq!(planned(text, vec![diagnosed()]).unwrap().step.copy_of, None);
        let stopped = Step { id: 1, writer: "study".to_owned(), outcome: Outcome::Cancelled, ..Step::default() };
        assert_eq!(planned(r#"{"command": "study"}"#, vec![stopped]).unwrap().step.copy_of, Some(1));
    }

    #[test]
    fn verif_what_does_not_fit_is_refused() {
        for (text, part) in [
            (r#"{"command": "shell"}"#, "unknown variant"),
            (r#"{"command": "compare", "words": []}"#, "unknown field"),
            (r#"{"command": "compare", "i_choose": true}"#, "carpus compare has no option `i_choose`"),
            (r#"{"command": "compare", "participants": ["P9"]}"#, "no participant `P9`"),
            (r#"{"command": "compare", "from_current": true}"#, "choose one participant"),
            (r#"{"command": "personalize", "from_current": true, "participants": ["P02"]}"#, "beside its file"),
            (r#"{"command": "effect_add"}"#, "at least one effect"),
            (r#"{"command": "effect_add", "effects": ["--out=/"]}"#, "letters, digits and _"),
            (r#"{"command": "effect_remove", "participants": ["P01"]}"#, "added no effects"),
        ] {
            let refused = planned(text, vec![diagnosed()]).unwrap_err();
            assert!(refused.contains(part), "{text}: {refused}");
        }
    }
}
