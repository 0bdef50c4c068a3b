//! Who was measured: a laboratory's table of anthropometry.

use std::path::Path;

use carpus_numerics::regular_file;
use carpus_study::study::{Participant, Sex, Side};

/// One pound [kg], one inch [m], one foot-pound [N·m].
const POUND: f64 = 0.453_592_37;
const INCH: f64 = 0.0254;
const FOOT_POUND: f64 = 1.355_818;

/// Reads a table with one row a person; `None` if the file is none.
pub fn read(path: &Path) -> Option<Vec<Participant>> {
    let bytes = regular_file::read(path).ok()?;
    let text = String::from_utf8(bytes).unwrap_or_else(|e| e.into_bytes().iter().map(|b| char::from(*b)).collect());
    let first = text.lines().find(|line| !line.trim().is_empty())?;
    let separator = [b';', b'\t', b','].into_iter().find(|c| first.as_bytes().contains(c))?;
    let mut reader = csv::ReaderBuilder::new()
        .delimiter(separator)
        .flexible(true)
        .trim(csv::Trim::All)
        .from_reader(text.trim_start_matches('\u{feff}').as_bytes());
    let header: Vec<String> = reader.headers().ok()?.iter().map(str::to_lowercase).collect();
    let at = |words: &[&str]| header.iter().position(|name| words.iter().any(|word| name.contains(word)));
    let who = header.iter().position(|name| {
        ["subject", "participant", "proband", "patient", "id", "vp", "teilnehmer", "code"]
            .iter()
            .any(|word| name.split(|c: char| !c.is_alphanumeric()).any(|part| part == *word))
    })?;
    let mass = at(&["mass", "weight", "gewicht", "masse"]);
    let height = at(&["height", "grösse", "größe", "groesse", "körpergr", "stature"]);
    mass.or(height)?;
    let sex = at(&["sex", "gender", "geschlecht"]);
    let side = at(&["side", "arm", "hand", "seite"]);
    let mvc = |words: &[&str]| {
        header.iter().position(|name| {
            (name.contains("mvc") || name.contains("max")) && words.iter().any(|word| name.contains(word))
        })
    };
    let (flexion, extension) = (mvc(&["flex"]), mvc(&["ext"]));
    let mut people = Vec::new();
    for record in reader.records() {
        let record = record.ok()?;
        let text = |i: Option<usize>| i.and_then(|i| record.get(i)).filter(|text| !text.is_empty());
        let number = |i: Option<usize>| text(i)?.replace(',', ".").parse::<f64>().ok().filter(|v| *v > 0.0);
        let is_in = |i: Option<usize>, unit: &str| i.is_some_and(|i| header[i].contains(unit));
        let Some(name) = text(Some(who)) else { continue };
        let of_mass = if is_in(mass, "lb") || is_in(mass, "pound") { POUND } else { 1.0 };
        let of_height = match number(height) {
            Some(_) if is_in(height, "inch") || is_in(height, "(in") => INCH,
            Some(value) if value > 3.0 => 0.01,
            _ => 1.0,
        };
        let moment = |i: Option<usize>| number(i).map(|m| if is_in(i, "ft") { m * FOOT_POUND } else { m });
        people.push(Participant {
            mass: number(mass).map(|v| v * of_mass),
            height: number(height).map(|v| v * of_height),
            sex: text(sex).and_then(|text| match text.to_lowercase().chars().next()? {
                'f' | 'w' => Some(Sex::Female),
                'm' => Some(Sex::Male),
                _ => Some(Sex::Other),
            }),
            side: text(side).and_then(|text| match text.to_lowercase().chars().next()? {
                'r' => Some(Side::Right),
                'l' => Some(Side::Left),
                _ => None,
            }),
            mvc_flexion: moment(flexion),
            mvc_extension: moment(extension),
            ..Participant::named(name)
        });
    }
    (!people.is_empty()).then_some(people)
}
