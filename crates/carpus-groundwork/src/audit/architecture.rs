//! Forces and lengths of muscles against published ones, the model's other muscles and the other side.

use super::super::model::LoadedModel;
use super::finding::{Check, Finding, Level};
use carpus_osim::osim::spec::MuscleSpec;

/// A published muscle.
struct Published {
    /// Its name in models, without a side.
    name: &'static str,
    /// Physiological cross-sectional area [cm²].
    area: f64,
    /// Optimal fibre length [m].
    optimal_fiber_length: f64,
}

/// The five prime movers of the wrist.
///
/// # References
/// Areas: Lieber, Fazeli & Botte 1990, J Hand Surg 15A:244. Optimal fibre lengths: Holzbaur, Murray & Delp 2005,
/// doi:10.1007/s10439-005-3320-7.
static PUBLISHED: [Published; 5] = [
    Published { name: "ECRL", area: 1.46, optimal_fiber_length: 0.081 },
    Published { name: "ECRB", area: 2.73, optimal_fiber_length: 0.0585 },
    Published { name: "ECU", area: 2.60, optimal_fiber_length: 0.0622 },
    Published { name: "FCR", area: 1.99, optimal_fiber_length: 0.0628 },
    Published { name: "FCU", area: 3.42, optimal_fiber_length: 0.0509 },
];
/// Where the areas and lengths are from.
const SOURCE: &str = "Lieber et al. 1990, Holzbaur et al. 2005";
/// Force per published area that a model may have [N/cm²]: 2 to 73 are reported of human muscle (Persad et al. 2024,
/// doi:10.1152/japplphysiol.00296.2024), but areas are those of cadavers and models are stronger: 74 to 231 in
/// MoBL-ARMS (Saul et al. 2015, doi:10.1080/10255842.2014.916698).
const TENSION: [f64; 2] = [10.0, 300.0];
/// Optimal fibre length over the published one that a model may have. Chosen, without a published range: wide, because
/// persons differ, and such that a slip of a unit or a decimal place lies outside.
const LENGTH_RATIO: [f64; 2] = [0.4, 1.8];
/// No muscle is this many times as strong as the next of its model.
const STRONGEST: f64 = 4.0;
/// Least number of other muscles that a strength is compared with.
const LEAST_OTHERS: usize = 4;
/// Twins of the two sides differ by less.
const TWIN: f64 = 1.2;

/// Findings about every muscle.
pub(super) fn findings(loaded: &LoadedModel) -> Vec<Finding> {
    let muscles = &loaded.file.spec.muscles;
    let mut findings: Vec<Finding> = muscles.iter().flat_map(against_published).collect();
    findings.extend(strongest(muscles));
    findings.extend(muscles.iter().flat_map(|muscle| twins(muscle, muscles)));
    findings
}

fn against_published(muscle: &MuscleSpec) -> Vec<Finding> {
    let Some(published) = PUBLISHED.iter().find(|p| side(&muscle.name).0 == p.name) else { return Vec::new() };
    let mut findings = Vec::new();
    let tension = muscle.max_isometric_force / published.area;
    if muscle.max_isometric_force > 0.0 && !(TENSION[0]..=TENSION[1]).contains(&tension) {
        let text = format!(
            "max_isometric_force of {} is {} N: {tension:.1} N per cm² of its published area of {} cm² (expected {} to \
             {})",
            muscle.name, muscle.max_isometric_force, published.area, TENSION[0], TENSION[1]
        );
        let hint = format!("check the number ({SOURCE})");
        let finding = Finding::new(Level::Warning, Check::Architecture, &muscle.at, text, hint);
        findings.push(finding.of_size(tension, "N/cm²"));
    }
    let ratio = muscle.optimal_fiber_length / published.optimal_fiber_length;
    if !(LENGTH_RATIO[0]..=LENGTH_RATIO[1]).contains(&ratio) {
        let text = format!(
            "optimal_fiber_length of {} is {} m: {ratio:.2} times the published {} m",
            muscle.name, muscle.optimal_fiber_length, published.optimal_fiber_length
        );
        let hint = format!("check the number ({SOURCE})");
        findings.push(Finding::new(Level::Warning, Check::Architecture, &muscle.at, text, hint).of_size(ratio, ""));
    }
    findings
}

/// A muscle far stronger than all others.
fn strongest(muscles: &[MuscleSpec]) -> Option<Finding> {
    let most = muscles.iter().max_by(|a, b| a.max_isometric_force.total_cmp(&b.max_isometric_force))?;
    let others = muscles.iter().filter(|m| m.name != most.name && side(&m.name).0 != side(&most.name).0);
    let others: Vec<f64> = others.map(|m| m.max_isometric_force).collect();
    let next = others.iter().copied().fold(0.0, f64::max);
    let ratio = most.max_isometric_force / next;
    (others.len() >= LEAST_OTHERS && next > 0.0 && ratio > STRONGEST).then(|| {
        let text = format!(
            "max_isometric_force of {} is {} N, {ratio:.1} times that of the model's next muscle ({next} N)",
            most.name, most.max_isometric_force
        );
        Finding::new(Level::Warning, Check::Architecture, &most.at, text, "check the number").of_size(ratio, "")
    })
}

/// Properties in which the muscle of the left differs from that of the right.
fn twins(muscle: &MuscleSpec, all: &[MuscleSpec]) -> Vec<Finding> {
    let (name, Some('l')) = side(&muscle.name) else { return Vec::new() };
    let Some(twin) = all.iter().find(|m| side(&m.name) == (name, Some('r'))) else { return Vec::new() };
    let properties = [
        ("max_isometric_force", muscle.max_isometric_force, twin.max_isometric_force),
        ("optimal_fiber_length", muscle.optimal_fiber_length, twin.optimal_fiber_length),
        ("tendon_slack_length", muscle.tendon_slack_length, twin.tendon_slack_length),
    ];
    let differ = properties.into_iter().filter(|(_, a, b)| a.max(*b) > TWIN * a.min(*b));
    differ
        .map(|(property, own, other)| {
            let text = format!("{property} of {} is {own}, of {} {other}", muscle.name, twin.name);
            let hint = "a person's sides differ little: check which of the two is right";
            Finding::new(Level::Warning, Check::Architecture, &muscle.at, text, hint)
                .of_size(own.max(other) / own.min(other), "")
        })
        .collect()
}

/// A name without its side, and the side.
fn side(name: &str) -> (&str, Option<char>) {
    for (end, side) in [("_l", 'l'), ("_r", 'r')] {
        if let Some(stem) = name.strip_suffix(end) {
            return (stem, Some(side));
        }
    }
    (name, None)
}
