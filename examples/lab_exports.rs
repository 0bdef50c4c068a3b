//! Writes one participant's recordings as four laboratories would export them.
//!
//! ```console
//! $ cargo run --example lab_exports -- exports
//! $ carpus init exports/biodex_delsys --model models/wrist.osim --yes
//! ```
//!
//! The participant is that of the bundled study, simulated by OpenSim (`fixtures/demo_study`). Moments, angles and
//! excitations are those of its trials; raw EMG is noise with the excitation as amplitude. Layouts:
//!
//! | folder | dynamometer | EMG | clocks |
//! |---|---|---|---|
//! | `biodex_delsys` | Biodex: equal column widths, ms | Delsys: a time column a channel, acceleration | one trigger |
//! | `humac_noraxon` | HUMAC: foot-pounds, reversed | Noraxon: names with commas, µV | torque as a voltage of the EMG |
//! | `one_file` | semicolons, decimal commas, units below, German | in the same file, mV | one |
//! | `workbook_matlab` | one workbook, a sheet a trial | one `.mat` file, a struct a trial, µV | one trigger |

#[path = "lab_exports/workbook_matlab.rs"]
mod workbook_matlab;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs, io};

use workbook_matlab::{EmgStruct, Sheet, write_matlab, write_workbook};

/// Muscles of the bundled study: name, as Delsys' users write it, as Noraxon abbreviates it, in Latin.
const MUSCLES: [[&str; 4]; 5] = [
    ["ECRL", "R EXTENSOR CARPI RADIALIS LONGUS", "RT EXT.CARP.RAD.L.", "M. extensor carpi radialis longus"],
    ["ECRB", "R EXTENSOR CARPI RADIALIS BREVIS", "RT EXT.CARP.RAD.B.", "M. extensor carpi radialis brevis"],
    ["ECU", "R EXTENSOR CARPI ULNARIS", "RT EXT.CARP.ULN.", "M. extensor carpi ulnaris"],
    ["FCR", "R FLEXOR CARPI RADIALIS", "RT FLEX.CARP.R", "M. flexor carpi radialis"],
    ["FCU", "R FLEXOR CARPI ULNARIS", "RT FLEX.CARP.U", "M. flexor carpi ulnaris"],
];
/// EMG at full excitation [µV].
const AMPLITUDE_MICROVOLT: [f64; 5] = [620.0, 480.0, 390.0, 710.0, 560.0];
/// Noise of the amplifiers [µV].
const FLOOR_MICROVOLT: f64 = 3.0;
/// Trials that are exported: the maximum contractions, half efforts, and the relaxed limb.
const EXPORTED: [&str; 18] = [
    "mvc_flexion",
    "mvc_extension",
    "isometric_50_flexion_-30deg_1",
    "isometric_50_flexion_+0deg_1",
    "isometric_50_flexion_+30deg_1",
    "isometric_50_flexion_-30deg_2",
    "isometric_50_extension_-30deg_1",
    "isometric_50_extension_+0deg_1",
    "isometric_50_extension_+30deg_1",
    "isometric_50_extension_+0deg_2",
    "isotonic_25_flexion_1",
    "isotonic_25_extension_1",
    "isotonic_50_flexion_1",
    "isotonic_50_flexion_2",
    "isotonic_50_extension_1",
    "isotonic_50_extension_2",
    "passive_1",
    "passive_2",
];

fn main() -> io::Result<()> {
    let out = env::args().nth(1).map_or_else(|| PathBuf::from("exports"), PathBuf::from);
    write(&out)?;
    println!("{}", out.display());
    Ok(())
}

/// Writes the four folders.
///
/// # Errors
/// The disk.
pub fn write(out: &Path) -> io::Result<()> {
    let trials = EXPORTED.iter().map(|name| Trial::read(name)).collect::<io::Result<Vec<_>>>()?;
    biodex_delsys(&out.join("biodex_delsys"), &trials)?;
    humac_noraxon(&out.join("humac_noraxon"), &trials)?;
    one_file(&out.join("one_file"), &trials)?;
    one_workbook(&out.join("workbook_matlab"), &trials)
}

/// A trial of the bundled study.
struct Trial {
    contraction: String,
    direction: Option<String>,
    effort: Option<u32>,
    posture: Option<i32>,
    repetition: u32,
    time: Vec<f64>,
    angle_deg: Vec<f64>,
    moment_n_m: Vec<f64>,
    excitation: Vec<Vec<f64>>,
}

impl Trial {
    fn read(name: &str) -> io::Result<Trial> {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/demo_study/data/P01");
        let text = fs::read_to_string(folder.join(format!("{name}.csv")))?;
        let rows: Vec<Vec<f64>> =
            text.lines().skip(1).map(|line| line.split(',').filter_map(|cell| cell.parse().ok()).collect()).collect();
        let column = |i: usize| rows.iter().map(|row| row[i]).collect::<Vec<f64>>();
        let words: Vec<&str> = name.split('_').collect();
        let direction = words.iter().find(|word| matches!(**word, "flexion" | "extension"));
        let posture = words.iter().find_map(|word| word.strip_suffix("deg")?.parse().ok());
        Ok(Trial {
            contraction: words[0].to_owned(),
            direction: direction.map(|word| (*word).to_owned()),
            effort: words.get(1).and_then(|word| word.parse().ok()).filter(|effort| *effort > 10),
            posture,
            repetition: words.last().and_then(|word| word.parse().ok()).unwrap_or(1),
            time: column(0),
            angle_deg: column(1),
            moment_n_m: column(2),
            excitation: (0..MUSCLES.len()).map(|i| column(3 + i)).collect(),
        })
    }

    /// Speed of the angle [deg/s].
    fn velocity(&self) -> Vec<f64> {
        let last = self.time.len() - 1;
        let at = |i: usize| {
            let (before, after) = (i.saturating_sub(1), (i + 1).min(last));
            (self.angle_deg[after] - self.angle_deg[before]) / (self.time[after] - self.time[before])
        };
        (0..=last).map(at).collect()
    }

    /// A quantity between the samples.
    fn at(&self, x: &[f64], t: f64) -> f64 {
        let after = self.time.partition_point(|known| *known <= t).clamp(1, self.time.len() - 1);
        let part = ((t - self.time[after - 1]) / (self.time[after] - self.time[after - 1])).clamp(0.0, 1.0);
        x[after - 1] + part * (x[after] - x[after - 1])
    }

    fn duration(&self) -> f64 {
        self.time[self.time.len() - 1]
    }

    /// Words of the file's name between separators.
    fn words(&self, of: impl Fn(&str) -> String, posture: impl Fn(i32) -> String) -> Vec<String> {
        let direction = self.direction.as_deref().map(&of);
        let mut words = vec![of(&self.contraction)];
        words.extend(direction);
        words.extend(self.effort.map(|effort| effort.to_string()));
        words.extend(self.posture.map(posture));
        words.push(self.repetition.to_string());
        words
    }
}

/// Gaussian noise, the same in every run.
struct Noise(u64);

impl Noise {
    fn uniform(&mut self) -> f64 {
        // The multiplier and increment of Knuth's MMIX.
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 11) as f64 + 0.5) / (1u64 << 53) as f64
    }

    fn gaussian(&mut self) -> f64 {
        (-2.0 * self.uniform().ln()).sqrt() * (std::f64::consts::TAU * self.uniform()).cos()
    }

    /// A sample of a muscle's surface EMG [µV].
    fn emg(&mut self, muscle: usize, excitation: f64) -> f64 {
        AMPLITUDE_MICROVOLT[muscle] * excitation * self.gaussian() + FLOOR_MICROVOLT * self.gaussian()
    }
}

/// Biodex beside Delsys, started by one trigger.
fn biodex_delsys(out: &Path, trials: &[Trial]) -> io::Result<()> {
    const RATE: f64 = 1_259.259_259;
    const MOTION_RATE: f64 = 148.148_148;
    let folders = [out.join("S01/Biodex"), out.join("S01/EMG")];
    folders.iter().try_for_each(fs::create_dir_all)?;
    fs::write(
        out.join("anthropometry.csv"),
        "Subject,Body mass (kg),Height (cm),Sex,Arm,\
         MVC flexion (Nm),MVC extension (Nm)\nS01,73,176,m,right,10.89,7.04\n",
    )?;
    for (i, trial) in trials.iter().enumerate() {
        let word = |word: &str| match word {
            "mvc" => "MVC".to_owned(),
            "isotonic" => "isokinetic".to_owned(),
            other => other.to_owned(),
        };
        let mut words = trial.words(word, |posture| format!("{posture:+}deg"));
        if let Some(last) = words.last_mut() {
            *last = format!("rep{last}");
        }
        let name = format!("S01_{}", words.join("_"));
        let velocity = trial.velocity();
        let mut text = format!("Raw Data Report\nS01   {}\n\n\n", words[0]);
        text.push_str("      TIME    TORQUE  POSITION POS (ANAT)  VELOCITY\n");
        text.push_str("      mSec       N-M   DEGREES   DEGREES   DEG/SEC\n");
        for (k, v) in velocity.iter().enumerate() {
            let (t, q, m) = (1000.0 * trial.time[k], trial.angle_deg[k], trial.moment_n_m[k]);
            let _ = writeln!(text, "{t:>10.0}{m:>10.2}{:>10.1}{q:>10.1}{v:>10.1}", q + 90.0);
        }
        fs::write(folders[0].join(format!("{name}.txt")), text)?;

        let mut noise = Noise(1000 + i as u64);
        let samples = (trial.duration() * RATE) as usize + 1;
        let moved = (trial.duration() * MOTION_RATE) as usize + 1;
        let mut text = String::new();
        let commas = ",".repeat(4 * MUSCLES.len() - 1);
        for (k, muscle) in MUSCLES.iter().enumerate() {
            let k = k + 1;
            let _ = writeln!(
                text,
                "Label: {}: EMG {k} Sampling frequency: {RATE:e} Number of points: \
                 {samples} start: 0.000000e+000 Unit: V \
                 Domain Unit: s{commas}\nLabel: {}: ACC.X {k} Sampling frequency: {MOTION_RATE:e} Number of points: \
                 {moved} start: 0.000000e+000 Unit: g Domain Unit: s{commas}",
                muscle[1], muscle[1]
            );
        }
        let _ = writeln!(text, "Start Trigger Method: External{commas}\nStop Trigger Method: None{commas}\n {commas}");
        let pair = |(k, muscle): (usize, &[&str; 4])| {
            format!("X[s],{}: EMG {},X[s],{}: ACC.X {}", muscle[1], k + 1, muscle[1], k + 1)
        };
        let _ = writeln!(text, "{}", MUSCLES.iter().enumerate().map(pair).collect::<Vec<_>>().join(","));
        for k in 0..samples {
            let t = k as f64 / RATE;
            let channel = |m: usize| {
                let volts = 1e-6 * noise.emg(m, trial.at(&trial.excitation[m], t));
                let motion = if k < moved {
                    format!("{:.6},{:.4}", k as f64 / MOTION_RATE, 0.01 * noise.gaussian())
                } else {
                    ",".to_owned()
                };
                format!("{t:.7},{volts:.4e},{motion}")
            };
            let _ = writeln!(text, "{}", (0..MUSCLES.len()).map(channel).collect::<Vec<_>>().join(","));
        }
        fs::write(folders[1].join(format!("{name}.csv")), text)?;
    }
    Ok(())
}

/// HUMAC in foot-pounds, extension positive, beside Noraxon, which recorded the torque's voltage, too, and was started
/// by hand.
fn humac_noraxon(out: &Path, trials: &[Trial]) -> io::Result<()> {
    const RATE: f64 = 1500.0;
    const NEWTON_METRES: f64 = 1.355_818;
    let folders = [out.join("P02/humac"), out.join("P02/noraxon")];
    folders.iter().try_for_each(fs::create_dir_all)?;
    for (i, trial) in trials.iter().enumerate() {
        let word = |word: &str| match word {
            "mvc" => "MVC".to_owned(),
            "isometric" => "ISOM".to_owned(),
            "isotonic" => "ISOT".to_owned(),
            "passive" => "PASSIVE".to_owned(),
            "flexion" => "FLEX".to_owned(),
            other => other[..3].to_uppercase(),
        };
        let name = trial.words(word, |posture| format!("{posture}deg")).join(" ");
        let velocity = trial.velocity();
        let mut text =
            "\"Status\",\"Time(Seconds)\",\"Position(Degrees)\",\"Torque(Foot-Pounds)\",\"Speed(d/s)\"\n".to_owned();
        for (k, v) in velocity.iter().enumerate() {
            let torque = -trial.moment_n_m[k] / NEWTON_METRES;
            let _ = writeln!(text, "\"1\",{:.2},{:.4},{torque:.4},{v:.4}", trial.time[k], trial.angle_deg[k]);
        }
        fs::write(folders[0].join(format!("{name}.csv")), text)?;

        let mut noise = Noise(2000 + i as u64);
        // Begun before the dynamometer, and ended after it.
        let early = 0.2 + 0.3 * noise.uniform();
        let samples = ((trial.duration() + early + 0.3) * RATE) as usize;
        let mut text = format!("\"Name\",\"{name}\"\n\"Type\",\"Raw\"\n\"Frequency, Hz\",\"{RATE}\"\n\"Time,s\"");
        text.extend(MUSCLES.iter().map(|muscle| format!(",\"{},uV\"", muscle[2])));
        text.push_str(",\"Torque,V\"\n");
        for k in 0..samples {
            let t = k as f64 / RATE - early;
            let _ = write!(text, "{:.5}", k as f64 / RATE);
            for m in 0..MUSCLES.len() {
                let _ = write!(text, ",{:.2}", noise.emg(m, trial.at(&trial.excitation[m], t)));
            }
            let volts = -0.1 * trial.at(&trial.moment_n_m, t) + 0.002 * noise.gaussian();
            let _ = writeln!(text, ",{volts:.4}");
        }
        fs::write(folders[1].join(format!("{name}_EMG.csv")), text)?;
    }
    Ok(())
}

/// Everything in one file, as a spreadsheet or a laboratory's own program writes it in Germany.
fn one_file(out: &Path, trials: &[Trial]) -> io::Result<()> {
    const RATE: f64 = 1000.0;
    let folder = out.join("P03");
    fs::create_dir_all(&folder)?;
    let decimal = |x: f64, places: usize| format!("{x:.places$}").replace('.', ",");
    for (i, trial) in trials.iter().enumerate() {
        let word = |word: &str| match word {
            "mvc" => "MVC".to_owned(),
            "isometric" => "isometrisch".to_owned(),
            "isotonic" => "isokinetisch".to_owned(),
            "passive" => "passiv".to_owned(),
            other => other.to_owned(),
        };
        let name = trial.words(word, |posture| format!("{posture}Grad")).join("_");
        let mut text = "Labor fuer Biomechanik;;;;;;;\nProband;P03;;;;;;\n\nZeit;Winkel;Drehmoment".to_owned();
        text.extend(MUSCLES.iter().map(|muscle| format!(";{}", muscle[3])));
        text.push_str("\ns;Grad;Nm;mV;mV;mV;mV;mV\n");
        let mut noise = Noise(3000 + i as u64);
        for k in 0..(trial.duration() * RATE) as usize {
            let t = k as f64 / RATE;
            let (q, m) = (trial.at(&trial.angle_deg, t), trial.at(&trial.moment_n_m, t));
            let mut row = vec![decimal(t, 3), decimal(q, 3), decimal(m + 0.02 * noise.gaussian(), 4)];
            let channel = |m: usize| decimal(1e-3 * noise.emg(m, trial.at(&trial.excitation[m], t)), 5);
            row.extend((0..MUSCLES.len()).map(channel));
            let _ = writeln!(text, "{}", row.join(";"));
        }
        fs::write(folder.join(format!("{name}.csv")), text)?;
    }
    Ok(())
}

/// A workbook of all exports of the dynamometer and a `.mat` file of all EMG.
fn one_workbook(out: &Path, trials: &[Trial]) -> io::Result<()> {
    const RATE: f64 = 2000.0;
    fs::create_dir_all(out)?;
    let (mut sheets, mut structs) = (Vec::new(), Vec::new());
    for (i, trial) in trials.iter().enumerate() {
        let word = |word: &str| match word {
            "mvc" => "MVC".to_owned(),
            "isotonic" => "isok".to_owned(),
            "isometric" => "isom".to_owned(),
            other => other.to_owned(),
        };
        let sign = |posture: i32| if posture < 0 { "n" } else { "p" };
        let words = trial.words(word, |posture| format!("{}{}deg", sign(posture), posture.abs()));
        let velocity = trial.velocity();
        let row = |k: usize| vec![trial.time[k], trial.moment_n_m[k], trial.angle_deg[k], velocity[k]];
        sheets.push(Sheet {
            name: words.join(" "),
            above: vec![["Patient".into(), "P04".into()], ["Protocol".into(), trial.contraction.clone()]],
            names: ["Time (s)", "Torque (Nm)", "Position (deg)", "Velocity (deg/s)"].map(String::from).to_vec(),
            rows: (0..trial.time.len()).map(row).collect(),
        });
        let mut noise = Noise(4000 + i as u64);
        let samples = (trial.duration() * RATE) as usize + 1;
        let mut channels = vec![Vec::with_capacity(samples); MUSCLES.len()];
        for k in 0..samples {
            for (m, channel) in channels.iter_mut().enumerate() {
                channel.push(noise.emg(m, trial.at(&trial.excitation[m], k as f64 / RATE)));
            }
        }
        let labels = MUSCLES.iter().map(|muscle| muscle[0].to_owned()).collect();
        structs.push(EmgStruct { name: words.join("_"), labels, channels, rate: RATE });
    }
    write_workbook(&out.join("P04_dynamometer.xlsx"), &sheets)?;
    write_matlab(&out.join("P04_emg.mat"), &structs)
}
