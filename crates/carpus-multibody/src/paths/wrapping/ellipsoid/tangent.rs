//! The point of an ellipse in the wrapping plane whose tangent passes through an end of the segment (OpenSim's
//! `WrapEllipsoid::calcTangentPoint`).

use super::super::rounding::normalize_or_zero;
use super::segment::WrappingPlane;
use nalgebra::{Matrix4, Vector3, Vector4};

/// The iteration ends when the sum of the four squared residuals is below this.
const TINY: f64 = 1e-8;
const MAX_ITERATIONS: usize = 50;
const MAX_LINE_STEPS: usize = 1000;
/// An end this near to the surface (value of its equation) is its own tangent point.
const ON_SURFACE_TOLERANCE: f64 = 1e-4;

/// Finds the tangent point from `p`, starting from `guess`; `level` is the value of the surface's equation at `p`.
///
/// Unknowns are the point r and the offset d of its tangent plane; residuals are: r in the wrapping plane, r on the
/// surface, r in its tangent plane, `p` in its tangent plane. The damped Gauss–Newton iteration, its line search that
/// doubles the step while the error falls and its loose end are OpenSim's, since the result depends on them.
pub(super) fn find(
    a: &Vector3<f64>,
    plane: &WrappingPlane,
    level: f64,
    p: &Vector3<f64>,
    guess: Vector3<f64>,
) -> Vector3<f64> {
    if level.abs() < ON_SURFACE_TOLERANCE {
        return *p;
    }
    let problem = Problem { inverse_a2: a.map(|a| 1.0 / (a * a)), plane, p };
    let mut r = guess;
    let mut d = -problem.normal(&r).dot(&r);
    let mut residual = problem.residual(&r, d);
    let mut ssq_before = residual.norm_squared();
    let mut ssq = ssq_before;
    let mut alpha = 0.01;
    let mut iterations = 0;
    while ssq > TINY && iterations < MAX_ITERATIONS {
        iterations += 1;
        let jacobian = problem.jacobian(&r);
        let slowing = slowing_near_radial(&r, p);
        let descent = -(jacobian * residual);
        let gram = jacobian * jacobian.transpose();

        let mut damped = gram;
        let mut step = Vector4::zeros();
        let mut line_steps = 0;
        while ssq >= ssq_before && line_steps < MAX_LINE_STEPS {
            for i in 0..4 {
                damped[(i, i)] = gram[(i, i)] * (1.0 + alpha);
            }
            step = solve(damped, descent) * (slowing / 16.0);
            r += step.xyz();
            d += step.w;
            residual = problem.residual(&r, d);
            ssq_before = ssq;
            ssq = residual.norm_squared();
            alpha *= 4.0;
            line_steps += 1;
        }
        alpha /= 8.0;

        let mut stretch = 0.5;
        line_steps = 0;
        while ssq <= ssq_before && line_steps < MAX_LINE_STEPS {
            stretch *= 2.0;
            r += step.xyz() * stretch;
            d += step.w * stretch;
            residual = problem.residual(&r, d);
            ssq_before = ssq;
            ssq = residual.norm_squared();
            line_steps += 1;
        }
        r -= step.xyz() * stretch;
        d -= step.w * stretch;
        residual = problem.residual(&r, d);
        ssq = residual.norm_squared();
        ssq_before = ssq;
    }
    r
}

/// Shortens the steps while `r` lies in the direction from the centre to `p`, where the tangent is undetermined.
fn slowing_near_radial(r: &Vector3<f64>, p: &Vector3<f64>) -> f64 {
    let cosine = normalize_or_zero(&(p - r)).dot(&normalize_or_zero(p));
    if cosine > 0.1 { 1.0 - cosine.powi(100) } else { 1.0 }
}

struct Problem<'a> {
    inverse_a2: Vector3<f64>,
    plane: &'a WrappingPlane,
    p: &'a Vector3<f64>,
}

impl Problem<'_> {
    /// Gradient of the surface's equation at `r`.
    fn normal(&self, r: &Vector3<f64>) -> Vector3<f64> {
        r.component_mul(&self.inverse_a2) * 2.0
    }

    fn residual(&self, r: &Vector3<f64>, d: f64) -> Vector4<f64> {
        let n = self.normal(r);
        let level = 0.5 * n.dot(r) - 1.0;
        Vector4::new(self.plane.normal.dot(r) + self.plane.offset, level, n.dot(r) + d, n.dot(self.p) + d)
    }

    /// Rows: unknowns; columns: residuals.
    fn jacobian(&self, r: &Vector3<f64>) -> Matrix4<f64> {
        let n = self.normal(r);
        let toward_p = self.normal(self.p);
        let v = &self.plane.normal;
        Matrix4::new(
            v.x,
            n.x,
            2.0 * n.x,
            toward_p.x, //
            v.y,
            n.y,
            2.0 * n.y,
            toward_p.y, //
            v.z,
            n.z,
            2.0 * n.z,
            toward_p.z, //
            0.0,
            0.0,
            1.0,
            1.0,
        )
    }
}

/// Solves a symmetric positive definite 4 × 4 system by Cholesky factorization; NaN if it is singular.
fn solve(m: Matrix4<f64>, b: Vector4<f64>) -> Vector4<f64> {
    let mut l = [[0.0; 4]; 4];
    let mut y = [0.0; 4];
    for i in 0..4 {
        for j in 0..=i {
            let mut sum = m[(i, j)];
            for k in 0..j {
                sum -= l[i][k] * l[j][k];
            }
            l[i][j] = if i == j { sum.sqrt() } else { sum / l[j][j] };
        }
        let mut sum = b[i];
        for k in 0..i {
            sum -= l[i][k] * y[k];
        }
        y[i] = sum / l[i][i];
    }
    let mut x = Vector4::zeros();
    for i in (0..4).rev() {
        let mut sum = y[i];
        for k in i + 1..4 {
            sum -= l[k][i] * x[k];
        }
        x[i] = sum / l[i][i];
    }
    x
}
