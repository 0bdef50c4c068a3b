//! Arguments of the commands about recordings.

use std::path::PathBuf;

use clap::Args;

use super::parts::text;

/// `carpus dynamometer-drag`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/dynamometer-drag.txt")))]
pub struct DynamometerDragArgs {
    /// Recordings of the machine alone, or a study
    #[arg(value_name = "FILE.csv…|STUDY/study.toml", required = true)]
    pub input: Vec<PathBuf>,
}

/// `carpus c3d`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/c3d.txt")))]
pub struct C3dArgs {
    /// The motion capture file
    #[arg(value_name = "FILE.c3d")]
    pub file: PathBuf,
    /// Folder to write into; carpus-output.json says what is from which recording
    #[arg(long, value_name = "DIR", default_value = ".")]
    pub out: PathBuf,
}
