//! A study in a temporary folder, to be spoilt one piece at a time.

use std::path::PathBuf;

use carpus::study::{Problem, Study, StudyErrors};

pub const TOML: &str = r#"[study]
name = "Two muscles"
model = "wrist.osim"

[dynamometer]
coordinate = "flexion"
damping_n_m_s_per_deg = 0.005
include = ["muscles", "passive"]

[posture_deg]
elbow_flexion = 90
pro_sup = -12.5

[muscles]
active = ["ECRL", "FCR"]

[emg]
kind = "normalized"
"#;
pub const PARTICIPANTS: &str = "\
participant,mass_kg,height_m,sex,side,hand_length_m,forearm_length_m,mvc_flexion_n_m,mvc_extension_n_m
P01,70.5,1.75,female,right,0.19,0.26,10,6
";
pub const TRIALS: &str = "\
participant,file,contraction,effort_percent,direction,posture_deg,repetition,use
P01,data/iso.csv,isometric,25,flexion,30,1,train
P01,data/dyn.csv,isotonic,50,extension,,1,test
";
pub const TRIAL_HEADER: &str = "time_s,angle_deg,moment_n_m,emg_ECRL,emg_FCR";
/// Samples of a generated trial.
pub const SAMPLES: usize = 50;

/// A study folder on disk; removed when dropped.
pub struct Folder {
    dir: tempfile::TempDir,
}

impl Folder {
    /// A study without a flaw.
    pub fn good() -> Self {
        let folder = Self { dir: tempfile::tempdir().expect("temporary folder") };
        folder.write("study.toml", TOML);
        folder.write("participants.csv", PARTICIPANTS);
        folder.write("trials.csv", TRIALS);
        folder.write("wrist.osim", "<OpenSimDocument Version=\"40000\"/>");
        folder.write("data/iso.csv", isometric());
        folder.write("data/dyn.csv", isotonic());
        folder
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().expect("has a parent")).expect("folder");
        std::fs::write(path, content).expect("write");
    }

    /// The good study with one text replaced in one file; the text must be there.
    pub fn spoilt(name: &str, from: &str, to: &str) -> Self {
        let folder = Self::good();
        folder.spoil(name, from, to);
        folder
    }

    pub fn spoil(&self, name: &str, from: &str, to: &str) {
        let text = std::fs::read_to_string(self.path(name)).expect("read");
        assert!(text.contains(from), "{name} has no {from:?}");
        self.write(name, text.replacen(from, to, 1));
    }

    /// The good study with a line (from 1) of one file replaced.
    pub fn with_line(name: &str, line: usize, to: &str) -> Self {
        let folder = Self::good();
        let text = std::fs::read_to_string(folder.path(name)).expect("read");
        let mut lines: Vec<&str> = text.lines().collect();
        lines[line - 1] = to;
        folder.write(name, lines.join("\n"));
        folder
    }

    pub fn read(&self) -> Result<Study, StudyErrors> {
        Study::read(self.path("study.toml"))
    }

    /// The errors of a study that must not be readable.
    pub fn errors(&self) -> Vec<Problem> {
        self.read().expect_err("the study has a flaw").errors
    }

    /// The only error, which must stand in `file` at `line`.
    pub fn only_error(&self, file: &str, line: impl Into<Option<usize>>) -> Problem {
        let errors = self.errors();
        assert_eq!(errors.len(), 1, "expected one error:\n{}", list(&errors));
        assert_eq!((errors[0].file.clone(), errors[0].line), (self.path(file), line.into()), "{}", errors[0]);
        errors.into_iter().next().expect("one error")
    }

    /// The only warning of a study that can be read.
    pub fn only_warning(&self, file: &str, line: impl Into<Option<usize>>) -> Problem {
        let warnings = self.read().unwrap_or_else(|e| panic!("{e}")).warnings;
        assert_eq!(warnings.len(), 1, "expected one warning:\n{}", list(&warnings));
        assert_eq!((warnings[0].file.clone(), warnings[0].line), (self.path(file), line.into()), "{}", warnings[0]);
        warnings.into_iter().next().expect("one warning")
    }
}

pub fn list(problems: &[Problem]) -> String {
    problems.iter().map(|p| format!("{p}\n")).collect()
}

/// Asserts what a message says; a hint, if `hint` is not empty.
pub fn says(problem: &Problem, message: &str, hint: &str) {
    assert!(problem.fault.to_string().contains(message), "{problem}\nlacks: {message}");
    assert!(problem.hint().unwrap_or_default().contains(hint), "{problem}\nlacks the hint: {hint}");
}

/// Flexion held at 30°, 25 % of 10 N·m.
fn isometric() -> String {
    rows(|t| [30.0 + 0.2 * (7.0 * t).sin(), 2.5 * t.min(1.0), 0.05 + 0.01 * t, 0.2 * t])
}

/// A sweep from −35° to 35° against 50 % of 6 N·m.
fn isotonic() -> String {
    rows(|t| [-35.0 * (6.0 * t).cos(), -3.0 + 0.2 * (5.0 * t).sin(), 0.4 + 0.1 * t, 0.1 * t])
}

fn rows(sample: impl Fn(f64) -> [f64; 4]) -> String {
    let mut text = format!("{TRIAL_HEADER}\n");
    for i in 0..SAMPLES {
        let t = i as f64 * 0.01;
        let [angle, moment, e1, e2] = sample(t);
        text += &format!("{t:.3},{angle},{moment},{e1},{e2}\n");
    }
    text
}
