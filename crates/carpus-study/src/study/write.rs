//! A study as files: the inverse of reading one. EMG is written as normalized excitation, columns under their usual
//! names.

use toml_edit::{DocumentMut, Item, Value};

use super::{MomentPart, Participant, RelativeBounds, Settings, Sex, Side, Trial, held_coordinates, posture_column};

/// The text of `study.toml`.
///
/// - `comment`: first lines, without `#`
/// - `model`: path of the model relative to the file
pub fn settings_text(settings: &Settings, name: &str, model: &str, comment: &str) -> String {
    let mut document = DocumentMut::new();
    document.decor_mut().set_prefix(comment.lines().map(|line| format!("# {line}\n")).collect::<String>());
    let mut section = |name: &str, keys: Vec<(&str, Value)>| {
        document.insert(name, Item::Table(keys.into_iter().collect()));
    };
    section("study", vec![("name", name.into()), ("model", model.into())]);
    let dynamometer = &settings.dynamometer;
    section(
        "dynamometer",
        vec![
            ("coordinate", dynamometer.coordinate.as_str().into()),
            ("damping_n_m_s_per_deg", number(dynamometer.damping * 1f64.to_radians(), 9)),
            ("include", dynamometer.include.iter().map(|part| part_word(*part)).collect()),
        ],
    );
    if !settings.posture.is_empty() {
        let held = settings.posture.iter().map(|held| (held.coordinate.as_str(), held.value_deg_or_m.into()));
        section("posture_deg", held.collect());
    }
    section("muscles", vec![("active", settings.active_muscles.iter().collect())]);
    section("emg", vec![("kind", "normalized".into())]);
    let bounds = &settings.bounds;
    let bound = |b: &RelativeBounds| [b.lower, b.upper].into_iter().map(|share| number(100.0 * share, 6)).collect();
    section(
        "personalization",
        vec![
            ("optimal_fiber_length", bound(&bounds.optimal_fiber_length)),
            ("tendon_slack_length", bound(&bounds.tendon_slack_length)),
            ("max_isometric_force", bound(&bounds.max_isometric_force)),
        ],
    );
    if let Some(gap) = settings.max_gap {
        section("checks", vec![("max_gap_s", gap.into())]);
    }
    if !settings.own_effects.is_empty() {
        section("effects", vec![("own", settings.own_effects.iter().map(|f| f.display().to_string()).collect())]);
    }
    document.to_string()
}

/// Header and rows of `participants.csv`; models as given beside each participant.
pub fn participant_rows(participants: &[(&Participant, Option<String>)]) -> Vec<Vec<String>> {
    let mut segments: Vec<&str> = Vec::new();
    for name in participants.iter().flat_map(|(p, _)| p.segment_lengths.iter().map(|(name, _)| name.as_str())) {
        if !segments.contains(&name) {
            segments.push(name);
        }
    }
    let mut header: Vec<String> =
        ["participant", "model", "mass_kg", "height_m", "sex", "side"].map(String::from).to_vec();
    header.extend(segments.iter().map(|s| format!("{s}_length_m")));
    header.extend(["mvc_flexion_n_m", "mvc_extension_n_m"].map(String::from));
    let in_groups: [(&str, fn(&Participant) -> &Option<String>); 3] =
        [("person", |p| &p.person), ("group", |p| &p.group), ("visit", |p| &p.visit)];
    let known: Vec<_> = in_groups.iter().filter(|(_, of)| participants.iter().any(|(p, _)| of(p).is_some())).collect();
    header.extend(known.iter().map(|(column, _)| (*column).to_owned()));
    let number = |v: Option<f64>, decimals| v.map(|v| decimal(v, decimals)).unwrap_or_default();
    let row = |(p, model): &(&Participant, Option<String>)| {
        let sex = p.sex.map_or("", |s| match s {
            Sex::Female => "female",
            Sex::Male => "male",
            Sex::Other => "other",
        });
        let side = p.side.map_or("", |s| match s {
            Side::Left => "left",
            Side::Right => "right",
        });
        let mut row = vec![p.name.clone(), model.clone().unwrap_or_default(), number(p.mass, 6), number(p.height, 6)];
        row.extend([sex.to_owned(), side.to_owned()]);
        let length = |s: &&str| p.segment_lengths.iter().find(|(name, _)| name == s).map(|(_, v)| *v);
        row.extend(segments.iter().map(|s| number(length(s), 6)));
        row.extend([number(p.mvc_flexion, 3), number(p.mvc_extension, 3)]);
        row.extend(known.iter().map(|(_, of)| of(p).clone().unwrap_or_default()));
        row
    };
    std::iter::once(header).chain(participants.iter().map(row)).collect()
}

/// Header and rows of `trials.csv`; every trial beside its file.
pub fn trial_list_rows(trials: &[(&Trial, String)]) -> Vec<Vec<String>> {
    let timed = trials.iter().any(|(t, _)| t.info.start_time.is_some());
    let mut header: Vec<String> =
        ["participant", "file", "contraction", "effort_percent", "direction", "posture_deg", "repetition", "use"]
            .map(String::from)
            .to_vec();
    header.extend(timed.then(|| "start_time_s".to_owned()));
    let turned = trials.iter().any(|(t, _)| t.info.arm_flipped);
    header.extend(turned.then(|| "arm".to_owned()));
    let held = held_coordinates(trials.iter().map(|(trial, _)| &trial.info));
    header.extend(held.iter().map(|coordinate| posture_column(coordinate)));
    let row = |(trial, file): &(&Trial, String)| {
        let info = &trial.info;
        let number = |v: Option<f64>| v.map(|v| decimal(v, 6)).unwrap_or_default();
        let mut row = vec![
            info.participant.clone(),
            file.clone(),
            info.contraction.word().to_owned(),
            number(info.effort_percent),
            info.direction.word().to_owned(),
            number(info.posture.map(f64::to_degrees)),
            info.repetition.map(|r| r.to_string()).unwrap_or_default(),
            info.usage.word().to_owned(),
        ];
        row.extend(timed.then(|| number(info.start_time)));
        row.extend(turned.then(|| info.arm_word().to_owned()));
        row.extend(held.iter().map(|coordinate| info.held_at(coordinate).map(|v| decimal(v, 6)).unwrap_or_default()));
        row
    };
    std::iter::once(header).chain(trials.iter().map(row)).collect()
}

/// Header and rows of a trial's file.
pub fn trial_rows(trial: &Trial, muscles: &[String]) -> Vec<Vec<String>> {
    let mut header: Vec<String> = ["time_s", "angle_deg", "moment_n_m"].map(String::from).to_vec();
    header.extend(muscles.iter().map(|m| format!("emg_{m}")));
    let row = |k: usize| {
        let mut row =
            vec![decimal(trial.time[k], 6), decimal(trial.angle[k].to_degrees(), 4), decimal(trial.moment[k], 5)];
        row.extend(trial.excitation.iter().map(|e| decimal(e[k], 5)));
        row
    };
    std::iter::once(header).chain((0..trial.len()).map(row)).collect()
}

fn part_word(part: MomentPart) -> &'static str {
    match part {
        MomentPart::Muscles => "muscles",
        MomentPart::Passive => "passive",
        MomentPart::Gravity => "gravity",
        MomentPart::Inertia => "inertia",
    }
}

/// At most so many decimals, without zeros at the end.
fn decimal(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

/// At most so many decimals of a number, as a value of TOML.
fn number(value: f64, decimals: usize) -> Value {
    decimal(value, decimals).parse().unwrap_or_else(|_| value.into())
}

/// A string of TOML.
pub fn toml_string(text: &str) -> String {
    Value::from(text).to_string()
}
