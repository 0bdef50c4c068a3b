//! How long loading, the first simulation and every further parameter set take.
//!
//! ```text
//! cargo bench --bench speed -- [--model MODEL.osim --motion TABLE.csv] [--posture elbow_flexion=90]… [--repeat N] \
//!     [--json]
//! ```
//! `TABLE.csv` is a table of `fixtures/scripts/prescribed_motion.py`: its angle and excitations are the trial, its
//! tendon forces (OpenSim at accuracy 1e-7) say how accurate the timed simulation is. Without arguments the bundled
//! wrist model and its reference table are used. One thread. The best of N repetitions counts, so that a busy machine
//! does not; for further parameter sets the mean over 21 different ones within 1 % of the model's own
//! (and within 10 %), repeated. `benches/speed.py` runs this together
//! with OpenSim.

use std::path::{Path, PathBuf};
use std::time::Instant;

use carpus::osim::OsimFile;
use carpus::simulation::{
    HeldCoordinate, MuscleParameters, MusculoskeletalModel, Options, PreparedTrial, Recording, Setup,
};
use carpus::study::MomentPart;

/// Parameter sets in one timing of further sets.
const PARAMETER_SETS: i32 = 20;

struct Arguments {
    model: PathBuf,
    reference: PathBuf,
    posture: Vec<HeldCoordinate>,
    repeat: usize,
    json: bool,
}

struct Reference {
    header: Vec<String>,
    columns: Vec<Vec<f64>>,
}

struct Timings {
    load: f64,
    compile: f64,
    first: f64,
    further: f64,
    distant: f64,
    with_derivatives: f64,
    force_error: f64,
    evaluations: usize,
    steps: usize,
    balances: f64,
    duration: f64,
    samples: usize,
    prepare: f64,
    tendon_force: Vec<(String, Vec<f64>)>,
}

fn main() {
    let arguments = match arguments() {
        Ok(arguments) => arguments,
        Err(message) => {
            eprintln!("{message}");
            std::process::exit(1);
        }
    };
    let reference = Reference::read(&arguments.reference);
    let timings = measure(&arguments, &reference);
    if arguments.json {
        println!("{}", timings.to_json(&arguments.model));
    } else {
        timings.print(&arguments.model);
    }
}

fn arguments() -> Result<Arguments, String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut out = Arguments {
        model: root.join("models/wrist.osim"),
        reference: root.join("fixtures/prescribed_motion/wrist.csv"),
        posture: Vec::new(),
        repeat: 21,
        json: false,
    };
    let mut files = [None, None];
    let mut given = std::env::args().skip(1);
    while let Some(argument) = given.next() {
        let mut value = || given.next().ok_or_else(|| format!("{argument}: expected a value"));
        match argument.as_str() {
            "--bench" => {} // cargo adds it
            "--json" => out.json = true,
            "--model" => files[0] = Some(PathBuf::from(value()?)),
            "--motion" => files[1] = Some(PathBuf::from(value()?)),
            "--repeat" => {
                let value = value()?;
                out.repeat = value.parse().map_err(|_| format!("--repeat {value}: expected a number"))?;
            }
            "--posture" => {
                let value = value()?;
                let parsed = value.split_once('=').and_then(|(name, v)| Some((name.to_owned(), v.parse().ok()?)));
                let (coordinate, value_deg_or_m) =
                    parsed.ok_or_else(|| format!("--posture {value}: expected COORDINATE=DEGREES"))?;
                out.posture.push(HeldCoordinate { coordinate, value_deg_or_m });
            }
            other => return Err(format!("unknown argument {other}")),
        }
    }
    match files {
        [Some(model), Some(reference)] => (out.model, out.reference) = (model, reference),
        [None, None] => {
            out.posture = vec![HeldCoordinate { coordinate: "elbow_flexion".into(), value_deg_or_m: 90.0 }];
        }
        _ => return Err("expected both --model and --motion, or neither".into()),
    }
    Ok(out)
}

impl Reference {
    fn read(path: &Path) -> Reference {
        let text = std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let mut lines = text.lines();
        let header: Vec<String> = lines.next().unwrap_or_default().split(',').map(str::to_owned).collect();
        let mut columns = vec![Vec::new(); header.len()];
        for line in lines {
            for (column, cell) in columns.iter_mut().zip(line.split(',')) {
                column.push(cell.parse().unwrap_or_else(|_| panic!("{}: `{cell}` is no number", path.display())));
            }
        }
        Reference { header, columns }
    }

    fn column(&self, name: &str) -> &[f64] {
        let index = self.header.iter().position(|h| h == name);
        &self.columns[index.unwrap_or_else(|| panic!("no column {name}"))]
    }

    fn muscles(&self) -> Vec<String> {
        self.header.iter().filter_map(|h| h.strip_suffix("_tendon_force")).map(str::to_owned).collect()
    }
}

/// Seconds of the fastest of some runs.
fn best(repeat: usize, mut run: impl FnMut()) -> f64 {
    let time = |_| {
        let start = Instant::now();
        run();
        start.elapsed().as_secs_f64()
    };
    (0..repeat.max(1)).map(time).fold(f64::INFINITY, f64::min)
}

fn measure(arguments: &Arguments, reference: &Reference) -> Timings {
    let muscles = reference.muscles();
    let setup = Setup {
        coordinate: "flexion".into(),
        posture: arguments.posture.clone(),
        active_muscles: muscles.clone(),
        parts: vec![MomentPart::Muscles, MomentPart::Passive],
        dynamometer_damping: 0.0,
        allow_unsupported: false,
    };
    let excitation: Vec<&[f64]> = muscles.iter().map(|m| reference.column(&format!("{m}_excitation"))).collect();
    let recording = Recording {
        name: "bench".into(),
        time: reference.column("time"),
        angle: reference.column("flexion"),
        excitation,
        held: Vec::new(),
    };
    let repeat = arguments.repeat;

    let load = best(repeat, || drop(OsimFile::read(&arguments.model).unwrap()));
    let file = OsimFile::read(&arguments.model).unwrap();
    let compile = best(repeat, || drop(MusculoskeletalModel::compile(&file.spec, &setup).unwrap()));
    let model = MusculoskeletalModel::compile(&file.spec, &setup).unwrap();
    let nominal = model.nominal_parameters();
    let first = best(repeat, || {
        let trial = model.prepare(&recording, &Options::default()).unwrap();
        trial.simulate(&nominal).unwrap();
    });
    let prepare = best(repeat, || drop(model.prepare(&recording, &Options::default()).unwrap()));
    let trial = model.prepare(&recording, &Options::default()).unwrap();

    // A search tries other parameters every time: up to 1 % from the model's own, and up to 10 %.
    let mut moment = vec![0.0; trial.len()];
    let mut mean_of_sets = |spacing: f64| {
        best(repeat, || {
            for set in 0..PARAMETER_SETS {
                total_moment(&trial, &nominal, 1.0 + spacing * (f64::from(set) - 9.5), &mut moment);
            }
        }) / f64::from(PARAMETER_SETS)
    };
    let (further, distant) = (mean_of_sets(1e-3), mean_of_sets(1e-2));
    let balances = (0..PARAMETER_SETS)
        .map(|set| total_moment(&trial, &nominal, 1.0 + 1e-3 * (f64::from(set) - 9.5), &mut moment))
        .sum::<usize>() as f64
        / f64::from(PARAMETER_SETS);
    let with_derivatives = best(repeat, || {
        for (muscle, p) in nominal.iter().enumerate() {
            trial.unit_moment_with_derivatives(muscle, p).unwrap();
        }
    });
    let result = trial.simulate(&nominal).unwrap();
    let force_error = muscles
        .iter()
        .enumerate()
        .flat_map(|(i, name)| {
            let expected = reference.column(&format!("{name}_tendon_force"));
            let maximum = nominal[i].max_isometric_force;
            result.muscles[i].tendon_force.iter().zip(expected).map(move |(a, b)| (a - b).abs() / maximum)
        })
        .fold(0.0, f64::max);
    let time = reference.column("time");
    Timings {
        load,
        compile,
        first,
        further,
        distant,
        with_derivatives,
        force_error,
        evaluations: trial.path_evaluations(),
        steps: result.work.steps,
        balances,
        duration: time[time.len() - 1] - time[0],
        samples: time.len(),
        prepare,
        tendon_force: muscles.into_iter().zip(result.muscles.into_iter().map(|m| m.tendon_force)).collect(),
    }
}

fn total_moment(trial: &PreparedTrial, nominal: &[MuscleParameters], factor: f64, moment: &mut [f64]) -> usize {
    moment.fill(0.0);
    let mut balances = 0;
    for (muscle, p) in nominal.iter().enumerate() {
        let candidate = MuscleParameters {
            optimal_fiber_length: factor * p.optimal_fiber_length,
            tendon_slack_length: p.tendon_slack_length * (2.0 - factor).sqrt(),
            ..*p
        };
        balances += trial.add_unit_moment(muscle, &candidate, moment).unwrap().residual_evaluations;
    }
    balances
}

impl Timings {
    fn to_json(&self, model: &Path) -> String {
        let forces: serde_json::Map<String, serde_json::Value> =
            self.tendon_force.iter().map(|(muscle, force)| (muscle.clone(), force.clone().into())).collect();
        serde_json::json!({
            "program": format!("carpus {}", env!("CARGO_PKG_VERSION")),
            "model": model.file_name().map(|n| n.to_string_lossy().into_owned()),
            "trial_s": self.duration,
            "samples": self.samples,
            "load_s": self.load + self.compile,
            "read_s": self.load,
            "first_trial_s": self.first,
            "prepare_s": self.prepare,
            "further_set_s": self.further,
            "distant_set_s": self.distant,
            "derivatives_s": self.with_derivatives,
            "force_error_per_fmax": self.force_error,
            "path_evaluations": self.evaluations,
            "integration_steps": self.steps,
            "force_balances": self.balances,
            "tendon_force": forces,
        })
        .to_string()
    }

    fn print(&self, model: &Path) {
        let ms = |seconds: f64| format!("{:9.3} ms", 1e3 * seconds);
        println!("{}: {} s of motion, {} samples", model.display(), self.duration, self.samples);
        println!("load                        {}", ms(self.load));
        println!("compile                     {}", ms(self.compile));
        println!("of it, preparation           {}", ms(self.prepare));
        println!("first run, paths included   {}  ({} evaluations)", ms(self.first), self.evaluations);
        println!(
            "further parameter set       {}  ({} fibre steps, {:.0} force balances)",
            ms(self.further),
            self.steps,
            self.balances
        );
        println!("a set up to 10 % away       {}", ms(self.distant));
        println!("with exact derivatives      {}", ms(self.with_derivatives));
        println!("largest force error         {:9.1e} of maximum isometric force (OpenSim at 1e-7)", self.force_error);
    }
}
