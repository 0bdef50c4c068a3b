//! The compiled path.

use super::error::PathError;
use super::functions::PathFunctions;
use super::wrapping::{ConstrainedHalf, Surface};
use crate::multibody::{BaseIndex, Cache, Model};
use carpus_numerics::spatial::Transform;
use carpus_osim::functions::Function;
use carpus_osim::osim::spec::{
    BodyIndex, CoordinateIndex, Location, ModelSpec, PathPointKind, PathPointSpec, PathSpec, PathWrapSpec,
    WrapObjectIndex, WrapObjectSpec, WrapShape,
};
use nalgebra::{Matrix3, Vector3};

/// Slack of a conditional point's range [rad or m] (OpenSim's `ConditionalPathPoint::isActive`).
const CONDITIONAL_TOLERANCE: f64 = 1e-5;

/// A `GeometryPath` or a `FunctionBasedPath`, compiled against a skeleton. Immutable.
#[derive(Clone, Debug)]
pub struct Path {
    pub(super) points: Vec<PathPoint>,
    pub(super) wraps: Vec<PathWrap>,
    /// What takes the place of points and wraps.
    pub(super) functions: Option<Box<PathFunctions>>,
}

/// A point of the path as the model states it.
#[derive(Clone, Debug)]
#[allow(non_snake_case)]
pub(super) struct PathPoint {
    /// What the point is fixed to, or moves on.
    pub base: BaseIndex,
    pub kind: PointKind,
}

#[derive(Clone, Debug)]
#[allow(non_snake_case)]
pub(super) enum PointKind {
    Fixed { p_BS: Vector3<f64> },
    Conditional { p_BS: Vector3<f64>, coordinate: CoordinateIndex, range: [f64; 2] },
    Moving(Box<MovingPoint>),
}

/// A `MovingPathPoint`; each component is a function of a coordinate, evaluated within the coordinate's range.
#[derive(Clone, Debug)]
#[allow(non_snake_case)]
pub(super) struct MovingPoint {
    pub X_BF: Transform,
    pub components: [MovingComponent; 3],
}

/// One component of a moving point's location in its frame.
#[derive(Clone, Debug)]
pub(super) struct MovingComponent {
    pub function: Function,
    pub argument: Option<(CoordinateIndex, [f64; 2])>,
}

/// One path over one wrap object.
#[derive(Clone, Debug)]
#[allow(non_snake_case)]
pub(super) struct PathWrap {
    pub object: WrapObjectIndex,
    pub base: BaseIndex,
    pub X_BW: Transform,
    pub surface: Surface,
    pub active: bool,
    /// First and last point between which the path may wrap, as positions among all points.
    pub first: usize,
    pub last: usize,
}

impl Path {
    /// Compiles a path.
    ///
    /// - `model_spec`: the specification that owns the path
    /// - `model`: the skeleton compiled from `model_spec`
    ///
    /// # Errors
    /// Any [`PathError`].
    pub fn compile(spec: &PathSpec, model_spec: &ModelSpec, model: &Model) -> Result<Path, PathError> {
        if let Some(functions) = &spec.functions {
            let functions = PathFunctions::compile(functions, &spec.at, model.n_coordinates())?;
            return Ok(Path { points: Vec::new(), wraps: Vec::new(), functions: Some(Box::new(functions)) });
        }
        if spec.points.len() < 2 {
            return Err(PathError::TooFewPoints { at: spec.at.clone(), found: spec.points.len() });
        }
        let points = spec.points.iter().map(|point| PathPoint::compile(point, model)).collect::<Result<_, _>>()?;
        let wraps =
            spec.wraps.iter().map(|wrap| PathWrap::compile(wrap, spec, model_spec, model)).collect::<Result<_, _>>()?;
        Ok(Path { points, wraps, functions: None })
    }

    /// Length of the straight lines through the points that are active [m]: what the path would be without wrapping;
    /// the length where functions give it.
    ///
    /// - `q`: all coordinates
    /// - `cache`: positions of the bodies at `q`
    #[allow(non_snake_case)]
    pub fn polyline_length(&self, q: &[f64], cache: &Cache) -> f64 {
        if let Some(functions) = &self.functions {
            return functions.length(q);
        }
        let active = self.points.iter().filter(|point| point.is_active(q));
        let mut previous: Option<Vector3<f64>> = None;
        let mut length = 0.0;
        for point in active {
            let p_GS = cache.X_GB(point.base) * point.location(q);
            if let Some(before) = previous {
                length += (p_GS - before).norm();
            }
            previous = Some(p_GS);
        }
        length
    }

    /// Bodies whose poses the path depends on, each once, ascending; ground is left out.
    pub fn bodies(&self) -> Vec<BodyIndex> {
        let bases = self.points.iter().map(|p| p.base).chain(self.wraps.iter().map(|w| w.base));
        let mut bodies: Vec<BodyIndex> = bases.filter_map(BaseIndex::body).collect();
        bodies.sort_unstable();
        bodies.dedup();
        bodies
    }

    /// Coordinates that the path depends on directly, through conditional and moving points or functions; each once,
    /// ascending.
    pub fn direct_coordinates(&self) -> Vec<CoordinateIndex> {
        let mut coordinates: Vec<CoordinateIndex> =
            self.functions.iter().flat_map(|functions| functions.coordinates.iter().copied()).collect();
        for point in &self.points {
            match &point.kind {
                PointKind::Fixed { .. } => {}
                PointKind::Conditional { coordinate, .. } => coordinates.push(*coordinate),
                PointKind::Moving(moving) => {
                    coordinates.extend(moving.components.iter().filter_map(|c| c.argument.map(|(c, _)| c)));
                }
            }
        }
        coordinates.sort_unstable();
        coordinates.dedup();
        coordinates
    }

    /// Whether length and moment arms can change with coordinate `c`, couplers followed: whether it moves what the path
    /// runs along against one another, or a point of it.
    pub fn depends_on(&self, model: &Model, c: CoordinateIndex) -> bool {
        let mut bases = self.points.iter().map(|p| p.base).chain(self.wraps.iter().map(|w| w.base));
        let first = bases.next();
        first.is_some_and(|first| bases.any(|base| model.moves_between(first, base, c)))
            || self.direct_coordinates().into_iter().any(|own| model.are_coupled(own, c))
    }

    /// Points that do not move in their body: what they are fixed to, and where in it [m].
    pub fn fixed_points(&self) -> impl Iterator<Item = (BaseIndex, Vector3<f64>)> + '_ {
        self.points.iter().filter_map(|point| match &point.kind {
            PointKind::Fixed { p_BS } | PointKind::Conditional { p_BS, .. } => Some((point.base, *p_BS)),
            PointKind::Moving(_) => None,
        })
    }

    /// Wrap objects of the path, in the order of its wraps.
    pub fn wrap_objects(&self) -> impl Iterator<Item = WrapObjectIndex> + '_ {
        self.wraps.iter().map(|wrap| wrap.object)
    }
}

impl PathPoint {
    fn compile(spec: &PathPointSpec, model: &Model) -> Result<PathPoint, PathError> {
        let frame = model.frames.get(spec.frame.0).ok_or_else(|| PathError::BadReference {
            at: spec.at.clone(),
            what: "frame",
            index: spec.frame.0,
            count: model.frames.len(),
        })?;
        let range_of = |coordinate: CoordinateIndex| {
            model.coordinates.get(coordinate.0).map(|c| c.range).ok_or_else(|| PathError::BadReference {
                at: spec.at.clone(),
                what: "coordinate",
                index: coordinate.0,
                count: model.coordinates.len(),
            })
        };
        let kind = match &spec.kind {
            PathPointKind::Fixed { location } => {
                require_finite(location, "location", &spec.at)?;
                PointKind::Fixed { p_BS: &frame.X_BF * location }
            }
            PathPointKind::Conditional { location, coordinate, range } => {
                require_finite(location, "location", &spec.at)?;
                range_of(*coordinate)?;
                PointKind::Conditional {
                    p_BS: &frame.X_BF * location,
                    coordinate: *coordinate,
                    range: [range[0] - CONDITIONAL_TOLERANCE, range[1] + CONDITIONAL_TOLERANCE],
                }
            }
            PathPointKind::Moving { location } => {
                let component = |i: usize| {
                    let (function, coordinate) = &location[i];
                    let property = ["x_location", "y_location", "z_location"][i];
                    let function = Function::compile(function).map_err(|source| PathError::Function {
                        at: spec.at.clone(),
                        property,
                        source,
                    })?;
                    let argument = coordinate.map(|c| range_of(c).map(|range| (c, range))).transpose()?;
                    Ok(MovingComponent { function, argument })
                };
                let components = [component(0)?, component(1)?, component(2)?];
                PointKind::Moving(Box::new(MovingPoint { X_BF: frame.X_BF, components }))
            }
        };
        Ok(PathPoint { base: frame.base, kind })
    }

    /// Whether the point is part of the path at `q`.
    #[inline]
    pub(super) fn is_active(&self, q: &[f64]) -> bool {
        match &self.kind {
            PointKind::Conditional { coordinate, range, .. } => (range[0]..=range[1]).contains(&q[coordinate.0]),
            PointKind::Fixed { .. } | PointKind::Moving(_) => true,
        }
    }

    /// Location in the base [m].
    #[inline]
    pub(super) fn location(&self, q: &[f64]) -> Vector3<f64> {
        match &self.kind {
            PointKind::Fixed { p_BS } | PointKind::Conditional { p_BS, .. } => *p_BS,
            PointKind::Moving(moving) => {
                let component = |i: usize| {
                    let MovingComponent { function, argument } = &moving.components[i];
                    let x = argument.map_or(0.0, |(c, range)| q[c.0].max(range[0]).min(range[1]));
                    function.value(x)
                };
                moving.X_BF * Vector3::new(component(0), component(1), component(2))
            }
        }
    }
}

impl MovingPoint {
    /// Velocity of the point in its base, expressed in ground, for the coordinate rates `rates`. As in OpenSim the
    /// slope is taken at the coordinate itself, even where the location stays at the end of its range.
    #[allow(non_snake_case)]
    pub(super) fn velocity_in_base(&self, R_GB: &Matrix3<f64>, q: &[f64], rates: &[f64]) -> Vector3<f64> {
        let component = |i: usize| {
            let MovingComponent { function, argument } = &self.components[i];
            argument.map_or(0.0, |(c, _)| match rates[c.0] {
                0.0 => 0.0,
                rate => function.derivative(q[c.0]) * rate,
            })
        };
        R_GB * (self.X_BF.R * Vector3::new(component(0), component(1), component(2)))
    }
}

impl MovingPoint {
    /// Derivative of the point's location by every coordinate that moves it in its base, expressed in ground.
    #[allow(non_snake_case)]
    pub(super) fn for_each_slope(
        &self,
        R_GB: &Matrix3<f64>,
        q: &[f64],
        mut visit: impl FnMut(CoordinateIndex, Vector3<f64>),
    ) {
        for (i, MovingComponent { function, argument }) in self.components.iter().enumerate() {
            if let Some((c, _)) = argument {
                visit(*c, R_GB * (self.X_BF.R.column(i) * function.derivative(q[c.0])));
            }
        }
    }
}

impl PathWrap {
    fn compile(
        spec: &PathWrapSpec,
        path: &PathSpec,
        model_spec: &ModelSpec,
        model: &Model,
    ) -> Result<PathWrap, PathError> {
        let index = spec.wrap_object.0;
        let (Some(object), Some(placement)) = (model_spec.wrap_objects.get(index), model.wrap_objects.get(index))
        else {
            let count = model.wrap_objects.len().min(model_spec.wrap_objects.len());
            return Err(PathError::BadReference { at: spec.at.clone(), what: "wrap object", index, count });
        };
        check_dimensions(object)?;
        let points = path.points.len();
        let [first, last] = spec.range;
        let position = |number: i32, default: usize| if number < 1 { default } else { number as usize - 1 };
        let (start, end) = (position(first, 0), position(last, points - 1));
        if start <= end && end >= points {
            return Err(PathError::WrapRange { at: spec.at.clone(), first, last, points });
        }
        Ok(PathWrap {
            object: spec.wrap_object,
            base: placement.base,
            X_BW: placement.X_BW,
            surface: Surface {
                shape: object.shape,
                half: ConstrainedHalf::from_quadrant(object.quadrant),
                method: spec.method,
                is_only_wrap_of_path: path.wraps.len() == 1,
            },
            active: object.active,
            first: start,
            last: end,
        })
    }
}

/// Refuses the dimensions that OpenSim refuses.
fn check_dimensions(object: &WrapObjectSpec) -> Result<(), PathError> {
    let check = |property: &'static str, found: f64, valid: bool, expected: &'static str| {
        if found.is_finite() && valid {
            Ok(())
        } else {
            Err(PathError::WrapDimension { at: object.at.clone(), property, expected, found })
        }
    };
    match object.shape {
        WrapShape::Sphere { radius } => check("radius", radius, radius >= 0.0, "a finite radius of 0 or more"),
        WrapShape::Cylinder { radius, length } => {
            check("radius", radius, radius >= 0.0, "a finite radius of 0 or more")?;
            check("length", length, length >= 0.0, "a finite length of 0 or more")
        }
        WrapShape::Ellipsoid { dimensions } => {
            dimensions.iter().try_for_each(|&d| check("dimensions", d, d > 0.0, "finite semi-axes above 0"))
        }
        WrapShape::Torus { inner_radius, outer_radius } => {
            check("inner_radius", inner_radius, inner_radius > 0.0, "a finite radius above 0")?;
            check("outer_radius", outer_radius, outer_radius > inner_radius, "a finite radius above inner_radius")
        }
    }
}

fn require_finite(v: &Vector3<f64>, property: &'static str, at: &Location) -> Result<(), PathError> {
    match v.iter().find(|x| !x.is_finite()) {
        Some(&found) => Err(PathError::NotFinite { at: at.clone(), property, found }),
        None => Ok(()),
    }
}
