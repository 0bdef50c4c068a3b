//! Ranges of coordinates, and couplers against them.

use super::super::info::unit_of;
use super::super::model::LoadedModel;
use super::finding::{Check, Finding, Level, shown};
use carpus_numerics::plausible::JOINT_ANGLE;
use carpus_osim::osim::spec::{ConstraintKind, CoordinateIndex, MotionType};

/// A joint of people turns less than a whole turn: a wider range of a joint within the body is none, or in degrees
/// [rad].
const WIDEST: f64 = std::f64::consts::TAU;
/// Limits beyond this are no limits (OpenSim's default is 99999.9) [rad, or degrees by mistake].
const NO_LIMIT: f64 = 720.0;
/// A narrower range of a joint [rad] may have been turned from degrees to radians twice.
const NARROWEST: f64 = 0.1;
/// What a coupler may exceed a range by, as a share of the range.
const EXCESS: f64 = 0.01;
/// Values of the coordinate that a coupler's follower is computed at.
const VALUES: usize = 61;

/// Findings about coordinates and couplers.
pub(super) fn findings(loaded: &LoadedModel) -> Vec<Finding> {
    let mut findings = widths(loaded);
    findings.extend(couplers(loaded));
    findings
}

fn widths(loaded: &LoadedModel) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (i, coordinate) in loaded.file.spec.coordinates.iter().enumerate() {
        let motion_type = loaded.model.coordinates[i].motion_type;
        let turns = motion_type == MotionType::Coupled && unit_of(&loaded.file.spec, CoordinateIndex(i)) == "deg";
        if !(motion_type == MotionType::Rotational || turns)
            || coordinate.locked
            || loaded.model.is_dependent(CoordinateIndex(i))
        {
            continue;
        }
        let [lower, upper] = coordinate.range;
        let width = upper - lower;
        if width > 0.0 && width < NARROWEST {
            let text =
                format!("the range of {} is {:.3}° wide ({lower} to {upper} rad)", coordinate.name, width.to_degrees());
            let hint = "check the unit: a range is in radians, and was it turned into them twice?";
            let finding = Finding::new(Level::Warning, Check::Range, &coordinate.at, text, hint);
            findings.push(finding.of_size(width.to_degrees(), "deg"));
        }
        // Whole bodies turn as they like in ground; larger limits are told by reading, or are none.
        let joint = &loaded.file.spec.joints[coordinate.joint.0];
        let in_body = loaded.model.frame(joint.parent_frame).base.body().is_some();
        let largest = lower.abs().max(upper.abs());
        let is_told = !turns && JOINT_ANGLE.doubt(largest).is_some();
        if in_body && coordinate.clamped && width > WIDEST && largest < NO_LIMIT && !is_told {
            let text = format!(
                "the range of {} is {:.0}° to {:.0}°: a joint does not turn so far",
                coordinate.name,
                lower.to_degrees(),
                upper.to_degrees()
            );
            let hint = "check the unit: a range is in radians; is it in degrees?";
            let finding = Finding::new(Level::Warning, Check::Range, &coordinate.at, text, hint);
            findings.push(finding.of_size(width.to_degrees(), "deg"));
        }
    }
    findings
}

/// Couplers that take a coordinate out of its range while the one it follows is within its own.
fn couplers(loaded: &LoadedModel) -> Vec<Finding> {
    let model = &loaded.model;
    let mut findings = Vec::new();
    for coupler in &model.couplers {
        let Some(argument) = coupler.only_argument() else { continue };
        let (independent, dependent) = (&model.coordinates[argument.0], &model.coordinates[coupler.dependent.0]);
        let ([from, to], [lower, upper]) = (independent.range, dependent.range);
        if [from, to, lower, upper].iter().any(|limit| limit.abs() > NO_LIMIT) || to <= from || upper <= lower {
            continue;
        }
        let mut q = model.default_coordinates();
        let mut worst: Option<(f64, f64, f64)> = None;
        for i in 0..VALUES {
            q[argument.0] = from + (to - from) * i as f64 / (VALUES - 1) as f64;
            let value = coupler.value(&q);
            let excess = (lower - value).max(value - upper);
            if excess > worst.map_or(EXCESS * (upper - lower), |(most, ..)| most) {
                worst = Some((excess, q[argument.0], value));
            }
        }
        let Some((excess, at, value)) = worst else { continue };
        let is_coupler = |kind: &ConstraintKind| {
            matches!(kind, ConstraintKind::CoordinateCoupler { dependent_coordinate, .. }
                if *dependent_coordinate == coupler.dependent)
        };
        let Some(spec) = loaded.file.spec.constraints.iter().find(|c| c.is_enforced && is_coupler(&c.kind)) else {
            continue;
        };
        let text = format!(
            "coupler {} takes {} to {} at {} = {}; its range is {} to {}",
            coupler.name,
            dependent.name,
            shown(loaded, coupler.dependent, value),
            independent.name,
            shown(loaded, argument, at),
            shown(loaded, coupler.dependent, lower),
            shown(loaded, coupler.dependent, upper)
        );
        let hint = "check the coupler's function and factor, or widen the range; values outside it are not clamped";
        // A follower's range is often left as it was.
        let size = excess / (upper - lower);
        let finding = Finding::new(Level::Warning, Check::Coupler, &spec.at, text, hint);
        findings.push(finding.of_size(size, "").over(loaded, argument));
    }
    findings
}
