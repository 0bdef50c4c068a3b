//! The `carpus` command: parses arguments, runs the command, sets the exit code.

fn main() -> std::process::ExitCode {
    carpus::cli::main()
}
