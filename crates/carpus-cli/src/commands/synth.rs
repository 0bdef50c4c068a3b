//! `carpus synth`: a study with a hidden effect.

use std::path::Path;

use crate::args::{Global, NoiseLevel, SynthArgs};
use crate::bars::Bars;
use crate::failure::Failure;
use crate::stdout::print_result;
use crate::study_run::StudyRun;
use crate::table::table;
use carpus_effects::synthesis::RecordingNoise;
use carpus_session::synth::{Made, ORIGIN, Synthesize, made_value};

/// Runs the command.
///
/// # Errors
/// The study, its models and trials, the effects and their sizes, or the output folder.
pub fn run(args: &SynthArgs, global: &Global) -> Result<(), Failure> {
    let noise = match args.noise {
        NoiseLevel::Realistic => RecordingNoise::REALISTIC,
        NoiseLevel::Small => RecordingNoise::REALISTIC.scaled(0.25),
        NoiseLevel::None => RecordingNoise::REALISTIC.scaled(0.0),
    };
    let request = Synthesize { effects: args.effects.clone(), noise, seed: global.seed };
    request.check()?;
    let study = StudyRun::prepare(&args.study, "synth")?;
    let made = study.study.synthesize(&request, &study.out, &Bars::new(global))?;
    study.close("synth")?;
    if global.json {
        return print_result(&made_value(&study.out.path().join("study.toml"), &made).to_string());
    }
    print_result(&readable(study.out.path(), &made))
}

fn readable(folder: &Path, made: &[Made]) -> String {
    let mut rows = Vec::new();
    for one in made {
        for (setting, reported) in one.effects.iter().zip(&one.reported) {
            let description = setting.effect.description();
            for (parameter, value) in description.parameters.iter().zip(reported) {
                let value = format!("{} {}", carpus_report::significant(*value, 4), parameter.unit);
                rows.push(vec![one.participant.name.clone(), description.id.into(), parameter.name.into(), value]);
            }
        }
    }
    let mut text = if rows.is_empty() {
        "nothing is hidden but the muscles' parameters".to_string()
    } else {
        table(&["participant", "hidden effect", "parameter", "value"], 4, rows)
    };
    let trials: usize = made.iter().map(|m| m.synthetic.trials.len()).sum();
    let file = |name: &str| folder.join(name).display().to_string();
    text.push_str(&format!(
        "\n\nthe study           {} ({trials} trials)\nwhat is hidden      {}\n{ORIGIN}\n",
        file("study.toml"),
        file("truth.json")
    ));
    text
}
