//! How long loading, the first simulation and every further parameter set take.
//!
//! ```text
//! cargo bench --bench speed -- MODEL.osim REFERENCE.csv [--posture elbow_flexion=90]… [--repeat N] [--json]
//! ```
//! `REFERENCE.csv` is a table of `fixtures/scripts/prescribed_motion.py`: its angle and excitations are the trial, its
//! tendon forces (OpenSim at accuracy 1e-7) say how accurate the timed simulation is. Without arguments the bundled
//! wrist model and its reference table are used. One thread; medians of N repetitions.

use std::path::{Path, PathBuf};
use std::time::Instant;

use carpus::osim::OsimFile;
use carpus::simulation::{
    HeldCoordinate, MuscleParameters, MusculoskeletalModel, Options, PreparedTrial, Recording, Setup,
};
use carpus::study::MomentPart;

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
    with_derivatives: f64,
    force_error: f64,
    evaluations: usize,
    steps: usize,
    duration: f64,
    samples: usize,
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
    let mut files = Vec::new();
    let mut given = std::env::args().skip(1);
    while let Some(argument) = given.next() {
        match argument.as_str() {
            "--bench" => {} // cargo adds it
            "--json" => out.json = true,
            "--repeat" => {
                let value = given.next().unwrap_or_default();
                out.repeat = value.parse().map_err(|_| format!("--repeat {value}: expected a number"))?;
            }
            "--posture" => {
                let value = given.next().unwrap_or_default();
                let parsed = value.split_once('=').and_then(|(name, v)| Some((name.to_owned(), v.parse().ok()?)));
                let (coordinate, value_deg_or_m) =
                    parsed.ok_or_else(|| format!("--posture {value}: expected COORDINATE=DEGREES"))?;
                out.posture.push(HeldCoordinate { coordinate, value_deg_or_m });
            }
            flag if flag.starts_with('-') => return Err(format!("unknown option {flag}")),
            file => files.push(PathBuf::from(file)),
        }
    }
    match <[PathBuf; 2]>::try_from(files) {
        Ok([model, reference]) => (out.model, out.reference) = (model, reference),
        Err(files) if files.is_empty() => {
            out.posture = vec![HeldCoordinate { coordinate: "elbow_flexion".into(), value_deg_or_m: 90.0 }];
        }
        Err(_) => return Err("expected MODEL.osim and REFERENCE.csv, or neither".into()),
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

fn median(repeat: usize, mut run: impl FnMut()) -> f64 {
    let mut seconds: Vec<f64> = (0..repeat.max(1))
        .map(|_| {
            let start = Instant::now();
            run();
            start.elapsed().as_secs_f64()
        })
        .collect();
    seconds.sort_by(f64::total_cmp);
    seconds[seconds.len() / 2]
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
    };
    let repeat = arguments.repeat;

    let load = median(repeat, || drop(OsimFile::read(&arguments.model).unwrap()));
    let file = OsimFile::read(&arguments.model).unwrap();
    let compile = median(repeat, || drop(MusculoskeletalModel::compile(&file.spec, &setup).unwrap()));
    let model = MusculoskeletalModel::compile(&file.spec, &setup).unwrap();
    let nominal = model.nominal_parameters();
    let first = median(repeat, || {
        let trial = model.prepare(&recording, &Options::default()).unwrap();
        trial.simulate(&nominal).unwrap();
    });
    let trial = model.prepare(&recording, &Options::default()).unwrap();

    // Every repetition takes other parameters, as a search does.
    let mut call = 0;
    let mut moment = vec![0.0; trial.len()];
    let further = median(20 * repeat, || {
        let factor = 1.0 + 1e-3 * f64::from(call % 21 - 10);
        call += 1;
        total_moment(&trial, &nominal, factor, &mut moment);
    });
    let with_derivatives = median(5 * repeat, || {
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
        with_derivatives,
        force_error,
        evaluations: trial.path_evaluations(),
        steps: result.work.steps,
        duration: time[time.len() - 1] - time[0],
        samples: time.len(),
    }
}

fn total_moment(trial: &PreparedTrial, nominal: &[MuscleParameters], factor: f64, moment: &mut [f64]) {
    moment.fill(0.0);
    for (muscle, p) in nominal.iter().enumerate() {
        let candidate = MuscleParameters {
            optimal_fiber_length: factor * p.optimal_fiber_length,
            tendon_slack_length: p.tendon_slack_length * (2.0 - factor).sqrt(),
            ..*p
        };
        trial.add_unit_moment(muscle, &candidate, moment).unwrap();
    }
}

impl Timings {
    fn to_json(&self, model: &Path) -> String {
        let value = serde_json::json!({
            "program": "carpus",
            "version": env!("CARGO_PKG_VERSION"),
            "model": model.file_name().map(|n| n.to_string_lossy().into_owned()),
            "trial_seconds": self.duration,
            "samples": self.samples,
            "threads": 1,
            "load_seconds": self.load,
            "compile_seconds": self.compile,
            "first_run_seconds": self.first,
            "further_parameter_set_seconds": self.further,
            "with_derivatives_seconds": self.with_derivatives,
            "largest_force_error_over_max_isometric_force": self.force_error,
            "path_and_force_evaluations": self.evaluations,
            "fibre_steps": self.steps,
        });
        value.to_string()
    }

    fn print(&self, model: &Path) {
        let ms = |seconds: f64| format!("{:9.3} ms", 1e3 * seconds);
        println!("{}: {} s of motion, {} samples", model.display(), self.duration, self.samples);
        println!("load                        {}", ms(self.load));
        println!("compile                     {}", ms(self.compile));
        println!("first run, paths included   {}  ({} evaluations)", ms(self.first), self.evaluations);
        println!("further parameter set       {}  ({} fibre steps)", ms(self.further), self.steps);
        println!("with exact derivatives      {}", ms(self.with_derivatives));
        println!("largest force error         {:9.1e} of maximum isometric force (OpenSim at 1e-7)", self.force_error);
    }
}
