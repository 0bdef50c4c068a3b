//! Bushings between two frames: moments and forces by deflections and their rates.

use super::error::{ForceError, check_finite, check_index};
use crate::multibody::{BaseIndex, Cache, Model};
use carpus_numerics::spatial::{
    SpatialForce, SpatialVelocity, Transform, angular_rate_matrix_body_xyz, body_xyz_angles,
};
use carpus_osim::functions::{Expression, Function};
use carpus_osim::osim::spec::{ForceKind, ForceSpec, FrameIndex};
use nalgebra::Vector3;

/// What a bushing resists its deflections with.
#[derive(Clone, Debug)]
pub enum BushingLaw {
    /// `FunctionBasedBushingForce`: m_x(θx), m_y(θy), m_z(θz), f_x(δx), f_y(δy), f_z(δz).
    Functions(Box<[Function; 6]>),
    /// `BushingForce`: stiffness of the six deflections [N·m/rad, N/m].
    Linear([f64; 6]),
    /// `ExpressionBasedBushingForce`: Mx, My, Mz, Fx, Fy, Fz, each a formula in all six deflections.
    Expressions(Box<[Expression; 6]>),
}

/// OpenSim's `BushingForce`, `FunctionBasedBushingForce` and `ExpressionBasedBushingForce` between frame F (`frame1`)
/// and frame M (`frame2`).
///
/// ```text
/// θ = body-fixed x-y-z angles of R_FM,  δ = p_FM (in F)
/// f_θ = −m(θ, δ) − D_r·θ̇,  f_δ = −f(θ, δ) − D_t·δ̇
/// on frame 2, at its origin: moment R_GM·Nᵀ(θ)·f_θ, force R_GF·f_δ; the opposite on frame 1
/// ```
/// with θ̇ = N(θ)·w_FM_M. Angles in radians in every function; moments [N·m], forces [N]. OpenSim: `TwoFrameLinker`;
/// Simbody: `Force::LinearBushing`.
#[derive(Clone, Debug)]
pub struct BushingForce {
    /// First frame, F.
    pub frame1: FrameIndex,
    /// Second frame, M.
    pub frame2: FrameIndex,
    /// Moments and forces by deflections.
    pub law: BushingLaw,
    /// Rotational damping [N·m·s/rad].
    pub rotational_damping: Vector3<f64>,
    /// Translational damping [N·s/m].
    pub translational_damping: Vector3<f64>,
}

/// Deflection of a bushing and its rate.
#[derive(Clone, Copy, Debug)]
#[allow(non_snake_case)]
struct Deflection {
    X_GF: Transform,
    X_GM: Transform,
    /// Angles [rad] and displacements [m].
    theta: Vector3<f64>,
    delta: Vector3<f64>,
}

impl BushingForce {
    pub(super) fn compile(force: &ForceSpec, model: &Model) -> Result<Self, ForceError> {
        const PROPERTIES: [&str; 6] = [
            "m_x_theta_x_function",
            "m_y_theta_y_function",
            "m_z_theta_z_function",
            "f_x_delta_x_function",
            "f_y_delta_y_function",
            "f_z_delta_z_function",
        ];
        const VARIABLES: [&str; 6] = ["theta_x", "theta_y", "theta_z", "delta_x", "delta_y", "delta_z"];
        let (frames, damping, law) = match &force.kind {
            ForceKind::FunctionBasedBushing {
                frame1,
                frame2,
                functions,
                rotational_damping,
                translational_damping,
            } => {
                let function = |i: usize| {
                    Function::compile(&functions[i]).map_err(|source| ForceError::Function {
                        at: force.at.clone(),
                        property: PROPERTIES[i],
                        source,
                    })
                };
                let functions = [function(0)?, function(1)?, function(2)?, function(3)?, function(4)?, function(5)?];
                let law = BushingLaw::Functions(Box::new(functions));
                ([*frame1, *frame2], [*rotational_damping, *translational_damping], law)
            }
            ForceKind::Bushing {
                frame1,
                frame2,
                rotational_stiffness: r,
                translational_stiffness: t,
                rotational_damping,
                translational_damping,
            } => {
                let stiffness = [r.x, r.y, r.z, t.x, t.y, t.z];
                for value in stiffness {
                    check_finite(&force.at, "stiffness", value)?;
                }
                let law = BushingLaw::Linear(stiffness);
                ([*frame1, *frame2], [*rotational_damping, *translational_damping], law)
            }
            ForceKind::ExpressionBasedBushing {
                frame1,
                frame2,
                expressions,
                rotational_damping,
                translational_damping,
            } => {
                let expression = |i: usize| {
                    Expression::parse_in(&expressions[i], &VARIABLES)
                        .map_err(|source| ForceError::Expression { at: force.at.clone(), source })
                };
                let all =
                    [expression(0)?, expression(1)?, expression(2)?, expression(3)?, expression(4)?, expression(5)?];
                let law = BushingLaw::Expressions(Box::new(all));
                ([*frame1, *frame2], [*rotational_damping, *translational_damping], law)
            }
            _ => unreachable!("called for bushings only"),
        };
        for frame in frames {
            check_index(&force.at, "frame", frame.0, model.frames.len())?;
        }
        for (damping, property) in damping.iter().zip(["rotational_damping", "translational_damping"]) {
            for &damping in damping {
                check_finite(&force.at, property, damping)?;
            }
        }
        let ([frame1, frame2], [rotational_damping, translational_damping]) = (frames, damping);
        Ok(Self { frame1, frame2, law, rotational_damping, translational_damping })
    }

    #[allow(non_snake_case)]
    fn deflection(&self, model: &Model, cache: &Cache) -> Deflection {
        let X_GF = cache.X_GF(model, self.frame1);
        let X_GM = cache.X_GF(model, self.frame2);
        let R_FM = X_GF.R.tr_mul(&X_GM.R);
        Deflection { X_GF, X_GM, theta: body_xyz_angles(&R_FM), delta: X_GF.inverse_transform_point(&X_GM.p) }
    }

    /// Moments [N·m] and forces [N] in the basis of the deflection (θ, δ), stiffness and damping together, as they act
    /// on frame 2.
    #[allow(non_snake_case)]
    fn internal_force(&self, model: &Model, cache: &Cache, at: &Deflection) -> (Vector3<f64>, Vector3<f64>) {
        let dq = [at.theta.x, at.theta.y, at.theta.z, at.delta.x, at.delta.y, at.delta.z];
        let stiffness = |k: usize| match &self.law {
            BushingLaw::Functions(functions) => -functions[k].value(dq[k]),
            BushingLaw::Linear(stiffness) => -stiffness[k] * dq[k],
            BushingLaw::Expressions(expressions) => -expressions[k].value_at(&dq),
        };
        let mut f_theta = Vector3::new(stiffness(0), stiffness(1), stiffness(2));
        let mut f_delta = Vector3::new(stiffness(3), stiffness(4), stiffness(5));
        if self.is_damped() {
            let (theta_dot, v_FM_F) = self.deflection_rate(model, cache, at);
            f_theta -= self.rotational_damping.component_mul(&theta_dot);
            f_delta -= self.translational_damping.component_mul(&v_FM_F);
        }
        (f_theta, f_delta)
    }

    fn is_damped(&self) -> bool {
        self.rotational_damping != Vector3::zeros() || self.translational_damping != Vector3::zeros()
    }

    /// Whether the force grows without bound towards θy = ±π/2, where the angles have their pole: whether rotation
    /// about x or z is damped. A motion that comes near is drawn into the pole, since a damper that turns it aside is
    /// ever stronger, D/cos² θy.
    pub fn has_pole(&self) -> bool {
        self.rotational_damping.x != 0.0 || self.rotational_damping.z != 0.0
    }

    /// |cos θy|: how far the deflection is from the pole of its angles.
    pub fn pole_margin(&self, model: &Model, cache: &Cache) -> f64 {
        self.deflection(model, cache).theta.y.cos().abs()
    }

    /// Rates of the deflections [rad/s, m/s].
    #[allow(non_snake_case)]
    fn deflection_rate(&self, model: &Model, cache: &Cache, at: &Deflection) -> (Vector3<f64>, Vector3<f64>) {
        let V_GF = self.frame_velocity(model, cache, self.frame1, |base| *cache.V_GB(base));
        let V_GM = self.frame_velocity(model, cache, self.frame2, |base| *cache.V_GB(base));
        let w_FM_M = at.X_GM.R.tr_mul(&(V_GM.w - V_GF.w));
        let p_FM_G = at.X_GM.p - at.X_GF.p;
        let v_FM_F = at.X_GF.R.tr_mul(&(V_GM.v - V_GF.v - V_GF.w.cross(&p_FM_G)));
        (angular_rate_matrix_body_xyz(&at.theta) * w_FM_M, v_FM_F)
    }

    /// Power that the dampers take [W].
    ///
    /// `cache` holds positions and velocities.
    pub fn dissipated_power(&self, model: &Model, cache: &Cache) -> f64 {
        if !self.is_damped() {
            return 0.0;
        }
        let (theta, delta) = self.deflection_rate(model, cache, &self.deflection(model, cache));
        let power = |damping: &Vector3<f64>, rate: &Vector3<f64>| damping.dot(&rate.component_mul(rate));
        power(&self.rotational_damping, &theta) + power(&self.translational_damping, &delta)
    }

    /// Forces on the two bodies at their origins, expressed in ground: what OpenSim reports for a `BushingForce`.
    pub fn forces_on_bodies(&self, model: &Model, cache: &Cache) -> [SpatialForce; 2] {
        let on_frames = self.forces_on_frames(model, cache);
        let frames = [self.frame1, self.frame2];
        std::array::from_fn(|k| {
            let offset = cache.X_GF(model, frames[k]).p - cache.X_GB(model.frame(frames[k]).base).p;
            on_frames[k].shift_to_origin(&offset)
        })
    }

    #[allow(non_snake_case)]
    fn frame_velocity(
        &self,
        model: &Model,
        cache: &Cache,
        frame: FrameIndex,
        of_base: impl Fn(BaseIndex) -> SpatialVelocity,
    ) -> SpatialVelocity {
        let frame = model.frame(frame);
        let p_BF_G = cache.X_GB(frame.base).R * frame.X_BF.p;
        of_base(frame.base).shift(&p_BF_G)
    }

    /// Moments and forces on frame 1 and frame 2, at their origins, expressed in ground.
    ///
    /// `cache` holds positions, and velocities if there is damping.
    #[allow(non_snake_case)]
    pub fn forces_on_frames(&self, model: &Model, cache: &Cache) -> [SpatialForce; 2] {
        let at = self.deflection(model, cache);
        let (f_theta, f_delta) = self.internal_force(model, cache, &at);
        let moment = at.X_GM.R * angular_rate_matrix_body_xyz(&at.theta).tr_mul(&f_theta);
        let on_frame2 = SpatialForce { moment, force: at.X_GF.R * f_delta };
        let p_FM_G = at.X_GM.p - at.X_GF.p;
        [-on_frame2.shift_to_origin(&p_FM_G), on_frame2]
    }

    /// Generalized force about the coordinate of the cache's unit motion.
    pub fn generalized_force(&self, model: &Model, cache: &Cache) -> f64 {
        let unit = |frame| self.frame_velocity(model, cache, frame, |base| *cache.partial_velocity(base));
        let (unit1, unit2) = (unit(self.frame1), unit(self.frame2));
        // The bushing often spans bodies that do not move with the coordinate of interest.
        if unit1 == unit2 && unit1 == SpatialVelocity::zero() {
            return 0.0;
        }
        let [on_frame1, on_frame2] = self.forces_on_frames(model, cache);
        on_frame1.power(&unit1) + on_frame2.power(&unit2)
    }
}
