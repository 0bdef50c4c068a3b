//! Masses and inertias that no body has.

use nalgebra::Vector3;

use super::super::model::LoadedModel;
use super::finding::{Check, Finding, Level};
use carpus_osim::osim::spec::{BodyIndex, BodySpec, PathPointKind};

/// Principal moments of a body obey I₃ ≤ I₁ + I₂; files round to some six digits, and published regressions to two.
const TRIANGLE: f64 = 1.05;
/// A body's mass lies within its own size: its radius of gyration is not this many times the distance of the farthest
/// thing that is fixed to it …
const GYRATION: f64 = 2.0;
/// … nor is it this long [m], where nothing is fixed far from the mass centre.
const LEAST_GYRATION: f64 = 0.25;
/// Lighter bodies stand between others: they are given any inertia that keeps equations regular [kg].
const LEAST_MASS: f64 = 0.001;

/// Bodies that are larger than what is fixed to them and are told one by one.
const MOST_LARGE: usize = 3;

/// Findings about bodies, and about what moves without mass.
pub(super) fn findings(loaded: &LoadedModel) -> Vec<Finding> {
    let spec = &loaded.file.spec;
    let mut findings: Vec<Finding> = Vec::new();
    let heavy = || spec.bodies.iter().enumerate().filter(|(_, body)| body.mass >= LEAST_MASS);
    findings.extend(spec.bodies.iter().filter(|body| body.mass > 0.0).filter_map(triangle));
    let mut large: Vec<Finding> = heavy().filter_map(|(i, body)| size(loaded, i, body)).collect();
    // Numbers that stand for none are the same for every body.
    if large.len() > MOST_LARGE {
        let more = format!("; so for {} more bodies", large.len() - 1);
        large.truncate(1);
        large[0].text.push_str(&more);
    }
    findings.extend(large);
    findings.extend(without_mass(loaded));
    findings
}

/// The inertia that no distribution of mass has.
fn triangle(body: &BodySpec) -> Option<Finding> {
    let mut principal: Vec<f64> = body.inertia.symmetric_eigenvalues().iter().copied().collect();
    principal.sort_by(f64::total_cmp);
    let [least, middle, most] = principal[..] else { return None };
    // A negative one is told by reading.
    (least >= 0.0 && most > TRIANGLE * (least + middle)).then(|| {
        let text = format!(
            "the principal moments of inertia of {} are {least:.3e}, {middle:.3e} and {most:.3e} kg·m²: the largest is \
             {:.1} times the sum of the others, and of no body is it more than the sum",
            body.name,
            most / (least + middle)
        );
        Finding::new(Level::Warning, Check::Inertia, &body.at, text, "check the three moments and their units")
            .of_size(most / (least + middle), "")
    })
}

/// The inertia of a body that would be far larger than what is fixed to it.
fn size(loaded: &LoadedModel, index: usize, body: &BodySpec) -> Option<Finding> {
    let radius = (body.inertia.diagonal().amax() / body.mass).sqrt();
    let extent = extent(loaded, index, body);
    (radius > LEAST_GYRATION && radius > GYRATION * extent).then(|| {
        let text = format!(
            "the radius of gyration of {} is {radius:.2} m, and nothing that is fixed to it is farther than \
             {extent:.2} m from its mass centre",
            body.name
        );
        let hint = "check the unit of mass and inertia: kg and kg·m² about the mass centre";
        Finding::new(Level::Warning, Check::Inertia, &body.at, text, hint).of_size(radius, "m")
    })
}

/// Distance of the farthest thing fixed to a body from its mass centre [m].
fn extent(loaded: &LoadedModel, index: usize, body: &BodySpec) -> f64 {
    let (spec, model) = (&loaded.file.spec, &loaded.model);
    let mut places: Vec<Vector3<f64>> = vec![Vector3::zeros()];
    let frames = model.frames.iter().filter(|f| f.base.body() == Some(BodyIndex(index)));
    places.extend(frames.map(|f| f.X_BF * Vector3::zeros()));
    for point in spec.muscles.iter().flat_map(|m| &m.path.points) {
        let frame = model.frame(point.frame);
        if let PathPointKind::Fixed { location } | PathPointKind::Conditional { location, .. } = &point.kind
            && frame.base.body() == Some(BodyIndex(index))
        {
            places.push(&frame.X_BF * location);
        }
    }
    places.iter().map(|place| (place - body.mass_center).norm()).fold(0.0, f64::max)
}

/// Coordinates that move nothing with a mass: no force can be computed from their accelerations.
fn without_mass(loaded: &LoadedModel) -> Option<Finding> {
    let (spec, model) = (&loaded.file.spec, &loaded.model);
    let (first, bodies) = (spec.bodies.first()?, 0..spec.bodies.len());
    if spec.bodies.iter().all(|body| body.mass == 0.0) {
        let hint = "give the bodies masses before forces of gravity or inertia are computed";
        return Some(Finding::new(Level::Note, Check::Inertia, &first.at, "no body has a mass", hint));
    }
    let parent = |body: usize| {
        let joint = model.inboard_joint(BodyIndex(body))?;
        model.frame(spec.joints[joint.0].parent_frame).base.body().map(|b| b.0)
    };
    let is_below = |body: usize, root: usize| {
        let chain = std::iter::successors(Some(body), |b| parent(*b)).take(spec.bodies.len());
        chain.into_iter().any(|b| b == root)
    };
    let carries_mass = |root: usize| bodies.clone().any(|b| spec.bodies[b].mass > 0.0 && is_below(b, root));
    let is_free = |body: usize| {
        let joint = model.inboard_joint(BodyIndex(body));
        let own = joint.map(|joint| spec.joints[joint.0].coordinates.as_slice()).unwrap_or_default();
        own.iter().any(|c| !model.coordinates[c.0].locked && !model.is_dependent(*c))
    };
    let found: Vec<usize> = bodies.clone().filter(|b| is_free(*b) && !carries_mass(*b)).collect();
    let at = &spec.bodies[*found.first()?].at;
    let names: Vec<&str> = found.iter().map(|b| spec.bodies[*b].name.as_str()).collect();
    let text = format!(
        "{} can move and {} no mass, nor has what {} carries",
        names.join(", "),
        if names.len() == 1 { "has" } else { "have" },
        if names.len() == 1 { "it" } else { "they" }
    );
    let hint = "give it a mass and an inertia, or lock its coordinates";
    Some(Finding::new(Level::Warning, Check::Inertia, at, text, hint).of_size(found.len() as f64, "bodies"))
}
