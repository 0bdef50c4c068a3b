//! `carpus live`: a study in progress, in a browser.

use serde_json::json;

use crate::args::{Global, LiveArgs};
use crate::failure::{self, Diagnostic, Failure};
use crate::stdout::print_result;
use carpus_live::{Program, Server, Settings};

/// Runs the command, until it is interrupted.
///
/// # Errors
/// No study, a folder that is not of it, a port that is taken.
pub fn run(args: &LiveArgs, global: &Global) -> Result<(), Failure> {
    let file = std::env::current_exe().map_err(|e| Failure::Internal(format!("the program's own file: {e}")))?;
    let server = Server::new(Settings {
        study: args.study.clone(),
        out: args.out.clone(),
        port: args.port.unwrap_or(0),
        seed: global.seed,
        allow_unsupported: args.allow_unsupported,
        program: Program { file, threads: global.threads.map(usize::from) },
    })?;
    let (address, port) = (server.address(), server.port());
    let tunnel = format!("ssh -L {port}:127.0.0.1:{port} HOST");
    print_result(&match global.json {
        true => json!({ "address": address, "port": port, "tunnel": tunnel }).to_string(),
        false => format!("open      {address}\nfrom afar  {tunnel}, then the same address\nend       Ctrl-C"),
    })?;
    if !args.no_browser
        && let Err(e) = open::that_detached(&address)
    {
        let message = Diagnostic::warning(format!("no browser can be opened: {e}"));
        failure::print(&[message.hint("open the address by hand")]);
    }
    server.serve()
}
