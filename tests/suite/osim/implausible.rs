//! Values that OpenSim takes and no person has.

use carpus::osim::{Diagnostic, OsimFile, Severity};

use super::small_models::FORMAT_40000;

/// Warnings of the small model with pieces of text replaced.
fn warnings(changes: &[(&str, &str)]) -> Vec<Diagnostic> {
    let mut text = FORMAT_40000.to_owned();
    for (from, to) in changes {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    let file = OsimFile::parse(text.as_bytes(), "small.osim").expect("readable");
    file.diagnostics.of(Severity::Warning).cloned().collect()
}

#[test]
fn verif_implausible_values_of_a_model_are_warned_of() {
    assert!(warnings(&[]).is_empty(), "{:?}", warnings(&[]));
    let pennation = "<tendon_slack_length>0.13</tendon_slack_length>";
    for (from, to, message, hint) in [
        (">0.16<", ">1e-9<", "optimal_fiber_length: 1e-9 is not plausible in m", "Ward"),
        (">0.16<", ">160<", "optimal_fiber_length: 160 is not plausible in m", "is it in mm? 160 mm are 0.16 m"),
        (">250<", ">1e-300<", "max_isometric_force: 1e-300 is not plausible in N", "Rajagopal"),
        (">1.5<", ">1500<", "mass: 1500 is not plausible in kg", "is it in g? 1500 g are 1.5 kg"),
        ("0 -9.80665 0", "0 -9806.65 0", "gravity: 9807 is not plausible in m/s²", "is it in mm/s²?"),
        ("<radius>0.01<", "<radius>10<", "radius: 10 is not plausible in m", "is it in mm? 10 mm are 0.01 m"),
        ("<translation>0 0 0<", "<translation>0 20 0<", "translation: 20 is not plausible in m", "is it in mm?"),
        ("<default_value>0.1<", "<default_value>45<", "default_value: 45 is not plausible in rad", "is it in degrees?"),
        ("<orientation>0 0 0<", "<orientation>0 90 0<", "orientation: 90 is not plausible in rad", "is it in degrees?"),
        ("<range>0 2.5<", "<range>-90 90<", "range: 90 is not plausible in rad", "90 degrees are 1.571 rad"),
        (
            pennation,
            &format!("{pennation}<minimum_activation>0.9</minimum_activation>"),
            "minimum_activation: 0.9 is not plausible in parts of 1",
            "is it in %?",
        ),
        (
            "<inertia>0.001 0.01 0.01",
            "<inertia>1000 10000 10000",
            "inertia (radius of gyration): 81.65 is not plausible in m",
            "is it in mm?",
        ),
        (
            pennation,
            &format!("{pennation}<pennation_angle_at_optimal>1.55</pennation_angle_at_optimal>"),
            "pennation_angle_at_optimal: 1.55 is not plausible in rad",
            "is it in degrees?",
        ),
    ] {
        let mut found = warnings(&[(from, to)]);
        // A default value is beyond its coordinate's range besides.
        found.retain(|d| !d.message.starts_with("default value 45 lies outside the range"));
        assert_eq!(found.len(), 1, "{to}: {found:?}");
        assert!(found[0].message.starts_with(message), "{}", found[0].message);
        assert!(found[0].hint.as_deref().unwrap_or_default().contains(hint), "{:?}", found[0].hint);
    }
}

#[test]
fn verif_a_range_without_end_is_plausible() {
    let found = warnings(&[("<range>0 2.5<", "<range>-99999.9 99999.9<")]);
    assert!(found.is_empty(), "{found:?}");
}

#[test]
fn verif_a_model_in_millimetres_is_one_warning_a_property() {
    let found = warnings(&[
        ("0.01 0.1 0<", "10 100 0<"),
        ("0.2 0.01 0<", "200 10 0<"),
        ("0.12 0 0<", "120 0 0<"),
        (">0.16<", ">160<"),
        (">0.13<", ">130<"),
    ]);
    let of = |property: &str| found.iter().filter(|d| d.message.starts_with(property)).collect::<Vec<_>>();
    let [points, centres, fibres, tendons] =
        ["location", "mass_center", "optimal_fiber_length", "tendon_slack"].map(of);
    assert_eq!([points.len(), centres.len(), fibres.len(), tendons.len()], [1; 4], "{found:?}");
    assert_eq!(points[0].also_at.len(), 1, "the second point");
    let line = FORMAT_40000[..FORMAT_40000.find("<location>").unwrap()].lines().count();
    assert_eq!(points[0].line, line);
    assert!(found.iter().all(|d| d.hint.as_deref().is_some_and(|hint| hint.contains("is it in mm?"))), "{found:?}");
}

#[test]
fn verif_an_empty_property_is_said_to_be_the_default() {
    let found = warnings(&[("<optimal_fiber_length>0.16</optimal_fiber_length>", "<optimal_fiber_length/>")]);
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(found[0].message.starts_with("optimal_fiber_length is empty: taken as 0.1, the default"), "{found:?}");
    let found = warnings(&[("<gravity>0 -9.80665 0</gravity>", "<gravity/>")]);
    assert!(found[0].message.starts_with("gravity is empty: taken as 0 -9.80665 0"), "{found:?}");
}
