//! `carpus live`: who may ask, steps and their folders, the check while files change, the way back, the end.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command as Process, Stdio};
use std::time::{Duration, Instant};

use predicates::str::contains;
use serde_json::{Value, json};

use crate::user_loop::{carpus, json as json_of, looped, read, root, small_study};

/// Whatever takes longer hangs: the slowest step takes a minute on a slow machine.
const PATIENCE: Duration = Duration::from_secs(300);

/// A server that runs until it is dropped.
struct Live {
    child: Child,
    port: u16,
    token: String,
}

/// An answer: status, head, body.
#[derive(Debug)]
struct Answer {
    status: u16,
    head: String,
    body: String,
}

impl Drop for Live {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Live {
    fn start(study: &Path, out: &Path) -> Live {
        let mut child = Process::new(env!("CARGO_BIN_EXE_carpus"))
            .arg("live")
            .arg(study)
            .arg("--out")
            .arg(out)
            .args(["--no-browser", "--json"])
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let said: Value = serde_json::from_str(&line).unwrap_or_else(|e| panic!("{line}: {e}"));
        let (_, token) = said["address"].as_str().unwrap().split_once("token=").unwrap();
        let (port, token) = (said["port"].as_u64().unwrap() as u16, token.to_owned());
        assert_eq!(said["tunnel"], format!("ssh -L {port}:127.0.0.1:{port} HOST"));
        Live { child, port, token }
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream
    }

    /// Asks with exactly these lines of the head.
    fn ask_with(&self, first: &str, head: &[&str], body: &str) -> Answer {
        let mut stream = self.connect();
        let head: String = head.iter().map(|line| format!("{line}\r\n")).collect();
        let length = body.len();
        write!(stream, "{first} HTTP/1.1\r\n{head}Connection: close\r\nContent-Length: {length}\r\n\r\n{body}")
            .unwrap();
        let mut bytes = Vec::new();
        stream.read_to_end(&mut bytes).unwrap();
        let text = String::from_utf8_lossy(&bytes).into_owned();
        let (head, body) = text.split_once("\r\n\r\n").unwrap_or_else(|| panic!("{text}"));
        let status = head.split(' ').nth(1).and_then(|code| code.parse().ok()).unwrap();
        Answer { status, head: head.to_owned(), body: body.to_owned() }
    }

    fn host(&self) -> String {
        format!("Host: 127.0.0.1:{}", self.port)
    }

    fn cookie(&self) -> String {
        format!("Cookie: carpus_live_{}={}", self.port, self.token)
    }

    fn get(&self, path: &str) -> Answer {
        self.ask_with(&format!("GET {path}"), &[&self.host(), &self.cookie()], "")
    }

    fn post(&self, path: &str, body: &Value) -> Answer {
        let origin = format!("Origin: http://127.0.0.1:{}", self.port);
        let head = [&self.host(), &self.cookie(), &origin, "Content-Type: application/json"];
        self.ask_with(&format!("POST {path}"), &head, &body.to_string())
    }

    fn state(&self) -> Value {
        let answer = self.get("/state");
        assert_eq!(answer.status, 200, "{answer:?}");
        serde_json::from_str(&answer.body).unwrap()
    }

    /// The state as soon as it is as wanted.
    fn when(&self, what: &str, is_wanted: impl Fn(&Value) -> bool) -> Value {
        let begun = Instant::now();
        loop {
            let state = self.state();
            if is_wanted(&state) {
                return state;
            }
            assert!(begun.elapsed() < PATIENCE, "{what}: {state}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// The state after so many checks.
    fn checked(&self, times: u64) -> Value {
        self.when("a check", |state| state["study"]["checks"].as_u64() >= Some(times))
    }

    /// Does a step to its end.
    fn step(&self, asked: &Value) -> Value {
        let answer = self.post("/run", asked);
        assert_eq!(answer.status, 202, "{answer:?}");
        self.when("the end of a step", |state| state["job"].is_null())
    }
}

/// Every file below a folder.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let (mut found, mut folders) = (BTreeMap::new(), vec![folder.to_owned()]);
    while let Some(at) = folders.pop() {
        for entry in std::fs::read_dir(&at).unwrap_or_else(|e| panic!("{}: {e}", at.display())) {
            let path = entry.unwrap().path();
            match path.is_dir() {
                true => folders.push(path),
                false => {
                    drop(found.insert(path.strip_prefix(folder).unwrap().to_owned(), std::fs::read(&path).unwrap()))
                }
            }
        }
    }
    found
}

fn copy(from: &Path, to: &Path) {
    for (file, bytes) in contents(from) {
        let target = to.join(file);
        std::fs::create_dir_all(target.parent().unwrap()).unwrap();
        std::fs::write(target, bytes).unwrap();
    }
}

/// What the command lines of a step give is what is in its folder, byte for byte.
fn assert_is_the_commands(step: &Value, out: &Path) {
    let folder = out.join(step["folder"].as_str().unwrap());
    let of_live = contents(&folder);
    std::fs::rename(&folder, out.with_extension("of_live")).unwrap();
    for line in step["commands"].as_array().unwrap() {
        let words: Vec<&str> = line.as_str().unwrap().split(' ').collect();
        match words.as_slice() {
            ["cp", "-r", from, to] => copy(from.as_ref(), to.as_ref()),
            ["carpus", words @ ..] => {
                drop(assert_cmd::Command::cargo_bin("carpus").unwrap().args(words).assert().success())
            }
            _ => panic!("{line}"),
        }
    }
    let of_command = contents(&folder);
    assert_eq!(of_live.keys().collect::<Vec<_>>(), of_command.keys().collect::<Vec<_>>());
    for (file, bytes) in &of_live {
        assert!(*bytes == of_command[file], "{}", file.display());
    }
    std::fs::remove_dir_all(out.with_extension("of_live")).unwrap();
}

#[test]
fn verif_only_who_has_the_token_and_comes_from_here_is_answered() {
    let folder = tempfile::tempdir().unwrap();
    let study = small_study(&folder.path().join("given"));
    let live = Live::start(&study, &folder.path().join("out"));
    let (host, cookie) = (live.host(), live.cookie());
    let get = |path: &str, head: &[&str]| live.ask_with(&format!("GET {path}"), head, "").status;

    // The token, in the address of the page or in the cookie.
    for path in
        ["/", "/state", "/events", "/live.js", "/files/01-compare/P01/report.html", "/nothing", "/?token=", "/?token=0"]
    {
        assert_eq!(get(path, &[&host]), 403, "{path}");
    }
    assert_eq!(get(&format!("/state?token={}", live.token), &[&host]), 403, "it is for the page alone");
    let wrong = format!("Cookie: carpus_live_{}={}", live.port, "0".repeat(32));
    assert_eq!(get("/state", &[&host, &wrong]), 403);
    let page = live.ask_with(&format!("GET /?token={}", live.token), &[&host], "");
    assert_eq!(page.status, 200);
    let head = page.head.to_lowercase();
    let set = format!("set-cookie: carpus_live_{}={}; path=/; httponly; samesite=strict", live.port, live.token);
    for part in ["content-security-policy: default-src 'none'; script-src 'self'", "nosniff", "no-referrer", &set] {
        assert!(head.contains(part), "{part}: {head}");
    }
    assert!(!head.contains("access-control"), "{head}");
    for path in ["/", "/live.js", "/live.css", "/state"] {
        assert_eq!(get(path, &[&host, &cookie]), 200, "{path}");
    }

    // The host that was asked.
    for host in ["Host: evil.example", "Host: 127.0.0.1.evil.example", "Host: 10.0.0.1"] {
        assert_eq!(get("/state", &[host, &cookie]), 403, "{host}");
    }
    assert_eq!(get("/state", &[&host, "Host: localhost", &cookie]), 403, "two hosts are none");
    assert_eq!(get("/state", &["Host: localhost:9000", &cookie]), 200, "a tunnel from another port");

    // What acts comes from the page.
    let post = |path: &str, head: &[&str], body: &str| {
        let all: Vec<&str> = [host.as_str(), &cookie, "Content-Type: application/json"]
            .into_iter()
            .chain(head.iter().copied())
            .collect();
        live.ask_with(&format!("POST {path}"), &all, body).status
    };
    let own = format!("Origin: http://127.0.0.1:{}", live.port);
    for origin in
        [vec![], vec!["Origin: http://evil.example"], vec!["Origin: null"], vec!["Origin: http://127.0.0.1:1"]]
    {
        assert_eq!(post("/go", &origin, "{\"step\": 0}"), 403, "{origin:?}");
    }
    assert_eq!(post("/go", &[&own], "{\"step\": 0}"), 200);
    assert_eq!(live.ask_with("GET /run", &[&host, &cookie], "").status, 405, "reading does nothing");
    let plain = live.ask_with("POST /go", &[&host, &cookie, &own, "Content-Type: text/plain"], "{\"step\": 0}");
    assert_eq!(plain.status, 415);
    for (path, body) in
        [("/go", json!({ "step": 7 })), ("/run", json!({ "command": "compare", "participants": ["--out"] }))]
    {
        let refused = live.post(path, &body);
        assert!(refused.status == 400 && refused.body.contains("there is no"), "{refused:?}");
    }
    assert_eq!(live.post("/run", &json!({ "command": "init" })).status, 422);

    // Nothing but files of steps.
    for path in [
        "/files/live/ledger.json",
        "/files/../given/study.toml",
        "/files/%2e%2e/given/study.toml",
        "/files//etc/passwd",
    ] {
        let status = live.get(path).status;
        assert!([404, 400].contains(&status), "{path}: {status}");
    }
}

#[test]
fn verif_a_step_has_the_files_of_its_command() {
    let folder = tempfile::tempdir().unwrap();
    let (study, out) = (small_study(&folder.path().join("given")), folder.path().join("out"));
    let live = Live::start(&study, &out);
    let state = live.checked(1);
    assert_eq!(state["study"]["check"]["schema"], "carpus.check/1");
    assert_ne!(state["study"]["check"]["level"], "red");
    assert_eq!(state["study"]["participants"], json!(["P01"]));
    assert!(state["study"]["effects"].as_array().unwrap().len() > 20);

    // Someone listens.
    let mut events = live.connect();
    write!(events, "GET /events HTTP/1.1\r\n{}\r\n{}\r\n\r\n", live.host(), live.cookie()).unwrap();
    let heard = std::thread::spawn(move || {
        let (mut progress, mut outcome) = (0, Value::Null);
        let lines = BufReader::new(events).lines().map_while(Result::ok);
        let mut kind = String::new();
        for line in lines {
            if let Some(name) = line.strip_prefix("event: ") {
                kind = name.to_owned();
            }
            let Some(data) = line.strip_prefix("data: ") else { continue };
            let data: Value = serde_json::from_str(data).unwrap();
            match kind.as_str() {
                "progress" => {
                    assert_eq!(data["step"], 1);
                    progress += 1;
                }
                _ => outcome = data["ledger"]["steps"][0]["outcome"].clone(),
            }
            if outcome == "done" {
                break;
            }
        }
        progress
    });
    let answer = live.post("/run", &json!({ "command": "personalize" }));
    assert_eq!((answer.status, answer.body.as_str()), (202, "{\"step\":1}"));
    let second = live.post("/run", &json!({ "command": "compare" }));
    assert!(second.status == 409 && second.body.contains("under way"), "{second:?}");
    let state = live.when("the fit", |state| state["job"].is_null());
    let step = &state["ledger"]["steps"][0];
    assert_eq!((&step["outcome"], &state["ledger"]["current"]), (&json!("done"), &json!(1)), "{step}");
    assert!(heard.join().unwrap() > 0, "progress is told");
    assert!(step["said"].as_str().unwrap().contains("Personalized"), "{step}");
    assert_eq!(step["pages"], json!(["01-personalize/P01/report.html"]));
    assert_eq!(step["models"]["P01"]["model"], "01-personalize/P01/model.osim");
    let report = live.get("/files/01-personalize/P01/report.html");
    assert!(report.body.contains("</html>") && report.head.contains("sandbox allow-scripts"), "{}", report.head);
    assert_eq!(json_of(out.join("live/ledger.json")), state["ledger"], "the ledger is what is shown");
    assert_is_the_commands(step, &out);

    // On the model of the step; then back to the study as it is.
    let compare = json!({ "command": "compare", "participants": ["P01"], "from_current": true });
    let state = live.step(&compare);
    let step = &state["ledger"]["steps"][1];
    assert_eq!((&step["parent"], &step["outcome"]), (&json!(1), &json!("done")), "{step}");
    assert!(step["commands"][0].as_str().unwrap().contains("--model"), "{step}");
    assert_is_the_commands(step, &out);
    assert_eq!(live.post("/go", &json!({ "step": 0 })).status, 200);
    let refused = live.post("/run", &compare);
    assert!(refused.status == 400 && refused.body.contains("no model of P01"), "{refused:?}");
    assert!(out.join("01-personalize/P01/model.osim").is_file() && out.join("02-compare").is_dir(), "nothing goes");
    let state = live.step(&json!({ "command": "compare" }));
    assert_eq!((&state["ledger"]["steps"][2]["parent"], &state["ledger"]["current"]), (&json!(0), &json!(3)));
}

#[test]
fn verif_a_file_that_changes_is_checked_anew() {
    let folder = tempfile::tempdir().unwrap();
    let (given, out) = (folder.path().join("given"), folder.path().join("out"));
    let study = small_study(&given);
    let live = Live::start(&study, &out);
    let first = live.checked(1);
    assert_ne!(first["study"]["check"]["level"], "red");
    let trial = given.join("data/P01/isotonic_25_flexion_1.csv");
    let good = read(trial.clone());
    std::fs::write(&trial, good.replacen("angle_deg", "angel_deg", 1)).unwrap();
    let second = live.checked(2);
    assert_eq!(second["study"]["check"]["level"], "red");
    let findings = second["study"]["check"]["findings"].to_string();
    assert!(findings.contains("isotonic_25_flexion_1.csv"), "{findings}");
    // A command says what is wrong, and the step has no results to go on with.
    let state = live.step(&json!({ "command": "compare" }));
    let step = &state["ledger"]["steps"][0];
    assert_eq!((&step["outcome"], &state["ledger"]["current"]), (&json!("failed"), &json!(0)), "{step}");
    assert!(step["messages"].to_string().contains("angle_deg"), "{step}");
    assert_eq!(live.post("/go", &json!({ "step": 1 })).status, 400);
    std::fs::write(&trial, &good).unwrap();
    let third = live.checked(3);
    assert_ne!(third["study"]["check"]["level"], "red");
    std::fs::remove_file(given.join("trials.csv")).unwrap();
    assert_eq!(live.checked(4)["study"]["check"]["level"], "red");
}

#[test]
fn verif_an_effect_of_the_study_s_own_is_read_anew() {
    let folder = tempfile::tempdir().unwrap();
    let given = folder.path().join("given");
    let study = small_study(&given);
    let file = given.join("cogging.toml");
    let text = read(root("docs/src/guide/cogging.toml"));
    std::fs::write(&file, &text).unwrap();
    std::fs::write(&study, read(study.clone()) + "\n[effects]\nown = [\"cogging.toml\"]\n").unwrap();
    let live = Live::start(&study, &folder.path().join("out"));
    let name = |state: &Value| {
        let all = state["study"]["effects"].as_array().unwrap();
        all.iter().find(|effect| effect["id"] == "cogging").map(|effect| effect["name"].as_str().unwrap().to_owned())
    };
    let first = live.checked(1);
    assert!(first["study"]["check"]["level"] != "red" && name(&first).is_some(), "{first}");
    let renamed = text.replace(&format!("\"{}\"", name(&first).unwrap()), "\"Teeth of the motor\"");
    std::fs::write(&file, renamed).unwrap();
    let second = live.checked(2);
    assert_eq!(name(&second).as_deref(), Some("Teeth of the motor"));
    assert_ne!(second["study"]["check"]["level"], "red", "{}", second["study"]["check"]["findings"]);
    std::fs::write(&file, "id = 3").unwrap();
    let third = live.checked(3);
    assert!(third["study"]["check"]["level"] == "red" || third["study"]["fault"].is_string(), "{third}");
}

#[test]
fn verif_a_command_is_stopped_and_the_server_ends() {
    let folder = tempfile::tempdir().unwrap();
    let (study, out) = (small_study(&folder.path().join("given")), folder.path().join("out"));
    let mut live = Live::start(&study, &out);
    live.checked(1);
    assert_eq!(live.post("/stop", &json!({})).status, 409, "nothing to stop");
    let begin = |live: &Live, request: Value| {
        assert_eq!(live.post("/run", &request).status, 202);
        live.when("progress", |state| state["job"]["at"]["what"] != "starting");
    };
    begin(&live, json!({ "command": "diagnose" }));
    assert_eq!(live.post("/stop", &json!({})).status, 202);
    let state = live.when("the end", |state| state["job"].is_null());
    assert_eq!(
        (&state["ledger"]["steps"][0]["outcome"], &state["ledger"]["current"]),
        (&json!("cancelled"), &json!(0))
    );
    // Another one can begin. The server ends with it.
    begin(&live, json!({ "command": "diagnose" }));
    let other = carpus().arg("live").arg(&study).arg("--out").arg(&out).arg("--no-browser").assert();
    other.code(1).stderr(contains("another carpus live works in this folder"));
    if cfg!(unix) {
        let sent = Process::new("kill").args(["-INT", &live.child.id().to_string()]).status().unwrap();
        assert!(sent.success());
        let begun = Instant::now();
        let status = loop {
            if let Some(status) = live.child.try_wait().unwrap() {
                break status;
            }
            assert!(begun.elapsed() < PATIENCE, "it does not end");
            std::thread::sleep(Duration::from_millis(50));
        };
        assert!(status.success(), "{status}");
        let ledger = json_of(out.join("live/ledger.json"));
        assert_eq!(ledger["steps"][1]["outcome"], "cancelled");
        // Another day.
        let again = Live::start(&study, &out);
        assert_eq!(again.state()["ledger"], ledger);
        again.checked(1);
        let state = again.step(&json!({ "command": "compare" }));
        assert_eq!(
            (&state["ledger"]["current"], &state["ledger"]["steps"][2]["folder"]),
            (&json!(3), &json!("03-compare"))
        );
    }
}

/// A folder of steps whose first one is a diagnosis, as a server left it. The diagnosis is that of the user's loop,
/// because one by the whole catalogue takes long.
fn diagnosed(out: &Path) -> PathBuf {
    let looped = looped();
    let study = looped.path("hidden/study.toml");
    let step = json!({
        "id": 1, "parent": 0, "label": "diagnose", "writer": "diagnose", "reads": [], "copy_of": null, "run_in": "",
        "commands": [], "folder": "01-diagnose", "outcome": "done", "pages": [], "models": {}, "said": "",
        "messages": [],
    });
    let study_file = study.canonicalize().unwrap();
    let ledger = json!({
        "schema": "carpus.live/1", "study": study, "study_file": study_file, "current": 1, "steps": [step],
    });
    copy(&looped.path("with"), &out.join("01-diagnose"));
    std::fs::create_dir_all(out.join("live")).unwrap();
    std::fs::write(out.join("live/ledger.json"), ledger.to_string()).unwrap();
    study
}

#[test]
fn verif_effects_are_added_removed_and_walked_back() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let study = diagnosed(&out);
    let live = Live::start(&study, &out);
    live.checked(1);
    let add = |choose: bool| json!({ "command": "effect_add", "effects": ["joint_stiffness"], "i_choose": choose });
    // The diagnosis cannot tell: a person has to insist.
    let state = live.step(&add(false));
    let step = &state["ledger"]["steps"][1];
    assert_eq!((&step["outcome"], &state["ledger"]["current"]), (&json!("failed"), &json!(1)), "{step}");
    assert!(step["messages"].to_string().contains("--i-choose"), "{step}");
    let state = live.step(&add(true));
    let step = &state["ledger"]["steps"][2];
    assert_eq!((&step["outcome"], &step["copy_of"]), (&json!("done"), &json!(1)), "{step}");
    assert_eq!(step["folder"], "03-effect-add");
    assert_is_the_commands(step, &out);

    let state = live.step(&json!({ "command": "effect_remove", "participants": ["P01"], "to": 1 }));
    let step = &state["ledger"]["steps"][3];
    assert_eq!((&step["outcome"], &step["copy_of"]), (&json!("done"), &json!(3)), "{step}");
    assert_is_the_commands(step, &out);
    let current = |step: &str| json_of(out.join(step).join("P01/ledger.json"))["current"].clone();
    assert_eq!((current("03-effect-add"), current("04-effect-remove")), (json!(2), json!(1)), "the step before stays");

    // Back to the model with the effect, and on from there.
    assert_eq!(live.post("/go", &json!({ "step": 3 })).status, 200);
    let state = live.step(&json!({ "command": "compare", "participants": ["P01"], "from_current": true }));
    let step = &state["ledger"]["steps"][4];
    assert_eq!((&step["parent"], &step["outcome"]), (&json!(3), &json!("done")), "{step}");
    let model = out.join("03-effect-add/P01/model.osim").display().to_string();
    assert!(step["commands"][0].as_str().unwrap().contains(&model), "{step}");
}

#[test]
fn verif_what_cannot_be_served_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let (study, out) = (small_study(&folder.path().join("given")), folder.path().join("out"));
    let refused = |study: &Path, out: &Path, more: &[&str], part: &str| {
        let mut command = carpus();
        command.arg("live").arg(study).arg("--out").arg(out).arg("--no-browser").args(more);
        command.assert().code(1).stderr(contains(part));
    };
    refused(&folder.path().join("nothing"), &out, &[], "expected a study");
    refused(&study, &folder.path().join("given"), &[], "not of carpus live");
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    refused(&study, &out, &["--port", &port], "cannot listen");
    let other = small_study(&folder.path().join("other"));
    refused(&other, &out, &[], "another study");
}

#[test]
#[cfg_attr(not(has_browser), ignore = "needs Chromium (CARPUS_CHROMIUM), Node and npm ci in crates/carpus-web/page")]
fn verif_the_page_runs_a_step_and_shows_its_report() {
    let folder = tempfile::tempdir().unwrap();
    let (study, out) = (small_study(&folder.path().join("given")), folder.path().join("out"));
    let live = Live::start(&study, &out);
    let seen = folder.path().join("seen.json");
    let output = Process::new("node")
        .arg(root("crates/carpus-web/page/test/server.mjs"))
        .arg(format!("http://127.0.0.1:{}/?token={}", live.port, live.token))
        .arg(&seen)
        .args(std::env::var_os("CARPUS_SCREENSHOTS"))
        .output()
        .expect("Node is here");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let seen = json_of(seen);
    assert_eq!(seen["complaints"], json!([]), "{seen}");
    assert_eq!(seen["foreign"], json!([]), "nothing is asked of anyone else");
    assert_eq!(seen["nameless"], json!([]), "controls without a name");
    assert_eq!(seen["address"], format!("http://127.0.0.1:{}/", live.port), "the token is out of sight");
    assert_eq!(seen["light"], "study: amber");
    assert!(seen["progress"].as_array().unwrap().len() > 1, "{seen}");
    assert_eq!(seen["report"]["computes"], true, "the report computes in its frame");
    assert_eq!(seen["report"]["reaches"], false, "a report has no access to the server");
    assert_eq!(seen["current"], json!(["1 personalize", "The study as it is", "1 personalize"]));
    assert!(seen["stopped"].as_str().unwrap().contains("stopped"), "{seen}");
}
