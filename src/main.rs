//! The `carpus` command: parses arguments, runs the command, sets the exit code.

fn main() -> std::process::ExitCode {
    // What estimates do, step by step, with RUST_LOG=debug.
    env_logger::init();
    carpus::cli::main()
}
