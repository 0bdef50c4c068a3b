//! Arguments of the commands about recordings.

use std::path::PathBuf;

use clap::Args;

/// `carpus dynamometer-drag`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  carpus dynamometer-drag machine_30.csv machine_60.csv machine_120.csv\n  carpus \
                  dynamometer-drag study/study.toml\n\nFiles have columns time_s, angle_deg, moment_n_m and perhaps \
                  velocity_deg_per_s; a study names them by [processing] drag_runs and [columns]. The moment of an \
                  empty machine at constant velocity is -drag x velocity - friction x sign(velocity) + offset + weight \
                  of the attachment; all are estimated together, and the interval holds although neighbouring samples \
                  err alike.")]
pub struct DynamometerDragArgs {
    /// Recordings of the machine alone, or a study
    #[arg(value_name = "FILE.csv…|STUDY/study.toml", required = true)]
    pub input: Vec<PathBuf>,
}

/// `carpus c3d`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  carpus c3d grasp_03.c3d --out grasp_03\n\nWrites FILE_markers.trc (in metres, for \
                  inverse kinematics and scaling; run-tool reads .c3d as marker file too) and\nFILE_analog.csv (time_s \
                  and every channel, scaled to its unit). Time begins at 0 with the first frame, as in OpenSim."
)]
pub struct C3dArgs {
    /// The motion capture file
    #[arg(value_name = "FILE.c3d")]
    pub file: PathBuf,
    /// Folder to write into; carpus-output.json says what is from which recording
    #[arg(long, value_name = "DIR", default_value = ".")]
    pub out: PathBuf,
}
