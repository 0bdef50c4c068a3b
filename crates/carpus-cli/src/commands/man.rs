//! `carpus man`: a man page for each command.

use clap::CommandFactory;

use crate::args::{Cli, ManArgs};
use crate::failure::Failure;
use crate::stdout::print_result;
use carpus_session::output::OutputFolder;

/// Runs the command.
///
/// # Errors
/// The folder.
pub fn run(args: &ManArgs) -> Result<(), Failure> {
    let folder = OutputFolder::create(&args.out, &[])?;
    let mut root = Cli::command();
    root.build();
    let mut written = 0;
    write(&folder, &root, &mut written)?;
    print_result(&format!("{written} man pages in {}", args.out.display()))
}

/// The page of a command and those of its subcommands.
fn write(folder: &OutputFolder, command: &clap::Command, written: &mut usize) -> Result<(), Failure> {
    let name = command.get_display_name().unwrap_or_else(|| command.get_name()).to_string();
    let mut page = Vec::new();
    let man = clap_mangen::Man::new(command.clone());
    man.render(&mut page).map_err(|e| Failure::Internal(format!("man page of {name}: {e}")))?;
    folder.write(format!("{name}.1"), &page)?;
    *written += 1;
    let documented = |c: &&clap::Command| !c.is_hide_set() && c.get_name() != "help";
    command.get_subcommands().filter(documented).try_for_each(|sub| write(folder, sub, written))
}
