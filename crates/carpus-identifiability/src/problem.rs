//! What is given and what is in question, and the moments that the model has for it.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::held::{Held, HeldTrial, View, add, whiten};
use super::parameters::{Layout, MuscleProperty, is_parameter};
use super::recorded::RecordedTrial;
use carpus_osim::osim::spec::MuscleSpec;
use carpus_simulation::simulation::{MuscleParameters, MusculoskeletalModel, Options, PreparedTrial, SimulationError};

/// Step of differences by logarithms of properties without exact derivatives.
const DIFFERENCE: f64 = 0.02;

/// A participant's model and training trials, and the parameters in question.
#[derive(Clone, Debug)]
pub(super) struct Problem {
    pub(super) model: MusculoskeletalModel,
    pub(super) specs: Vec<MuscleSpec>,
    pub(super) nominal: Vec<MuscleParameters>,
    pub(super) layout: Layout,
    pub(super) trials: Vec<RecordedTrial>,
    pub(super) options: Options,
}

/// A muscle's unit force with derivatives by the logarithms of its shape parameters.
struct UnitForce {
    force: Vec<f64>,
    by: Vec<(usize, Vec<f64>)>,
}

struct Variants {
    here: MusculoskeletalModel,
    sides: Vec<Option<[MusculoskeletalModel; 2]>>,
}

struct PreparedVariants {
    here: Vec<PreparedTrial>,
    sides: Vec<Option<[Vec<PreparedTrial>; 2]>>,
}

impl Problem {
    pub(super) fn n_muscles(&self) -> usize {
        self.nominal.len()
    }

    /// Per trial: whitened columns [∂τ by parameters | by baselines | residual].
    pub(super) fn whitened(&self, held: &Held, at: &DVector<f64>) -> Result<Vec<DMatrix<f64>>, SimulationError> {
        let columns = self.columns(held, at)?;
        Ok(columns.iter().zip(&held.trials).map(|(c, t)| whiten(&t.factor, c)).collect())
    }

    /// Per trial: columns [∂τ by parameters | by baselines | residual].
    pub(super) fn columns(&self, held: &Held, at: &DVector<f64>) -> Result<Vec<DMatrix<f64>>, SimulationError> {
        let (p, m) = (self.layout.len(), self.n_muscles());
        let variants = self.variants(at)?;
        let all: Vec<Result<DMatrix<f64>, SimulationError>> = held
            .trials
            .par_iter()
            .zip(&self.trials)
            .map(|(held, trial)| {
                let variants = self.prepared_variants(held, trial, &variants)?;
                let mut out = DMatrix::zeros(held.target.len(), p + m + 1);
                let mut residual = held.target.clone();
                for muscle in 0..m {
                    let strength: f64 = self.layout.strengths[muscle].iter().map(|i| at[*i]).sum();
                    let scale = self.nominal[muscle].max_isometric_force * strength.exp();
                    let unit = self.unit_force(held, &variants, muscle, at)?;
                    let moment = trial.moments_of(muscle, &unit.force, &held.starts) * scale;
                    residual -= &moment;
                    for i in &self.layout.strengths[muscle] {
                        out.column_mut(*i).axpy(1.0, &moment, 1.0);
                    }
                    for (i, by) in &unit.by {
                        let by = trial.moments_of(muscle, by, &held.starts);
                        out.column_mut(*i).axpy(scale, &by, 1.0);
                    }
                    let baseline = held.baselines.column(muscle);
                    residual.axpy(-at[p + muscle], &baseline, 1.0);
                    out.set_column(p + muscle, &baseline);
                }
                out.set_column(p + m, &residual);
                Ok(out)
            })
            .collect();
        all.into_iter().collect()
    }

    /// Per trial and muscle: block means of the moment.
    pub(super) fn muscle_moments(
        &self,
        held: &Held,
        at: &DVector<f64>,
    ) -> Result<Vec<Vec<DVector<f64>>>, SimulationError> {
        let variants = self.variants(at)?;
        let all: Vec<Result<Vec<DVector<f64>>, SimulationError>> = held
            .trials
            .par_iter()
            .zip(&self.trials)
            .map(|(held, trial)| {
                let variants = self.prepared_variants(held, trial, &variants)?;
                (0..self.n_muscles())
                    .map(|muscle| {
                        let strength: f64 = self.layout.strengths[muscle].iter().map(|i| at[*i]).sum();
                        let scale = self.nominal[muscle].max_isometric_force * strength.exp();
                        let unit = self.unit_force(held, &variants, muscle, at)?;
                        Ok(trial.moments_of(muscle, &unit.force, &held.starts) * scale)
                    })
                    .collect()
            })
            .collect();
        all.into_iter().collect()
    }

    /// Models with other curves: at the point, and on both sides by every parameter that needs differences.
    fn variants(&self, at: &DVector<f64>) -> Result<Option<Variants>, SimulationError> {
        if !self.layout.changes_model() {
            return Ok(None);
        }
        let model_at = |at: &DVector<f64>| self.model_with(&|_, i| at[i]);
        let sides = self
            .layout
            .free
            .iter()
            .enumerate()
            .map(|(i, p)| {
                if is_parameter(p.property) {
                    return Ok(None);
                }
                let moved = |step: f64| {
                    let mut at = at.clone();
                    at[i] += step;
                    model_at(&at)
                };
                Ok(Some([moved(DIFFERENCE)?, moved(-DIFFERENCE)?]))
            })
            .collect::<Result<_, SimulationError>>()?;
        Ok(Some(Variants { here: model_at(at)?, sides }))
    }

    /// The model with curves, damping and activation of every muscle at logarithms of factors.
    pub(super) fn model_with(
        &self,
        value: &dyn Fn(usize, usize) -> f64,
    ) -> Result<MusculoskeletalModel, SimulationError> {
        let mut specs = self.specs.clone();
        for (m, spec) in specs.iter_mut().enumerate() {
            self.layout.change(m, spec, &|i| value(m, i));
        }
        self.model.with_muscles(&specs)
    }

    /// A trial prepared for another model, with every excitation of its views.
    pub(super) fn prepare(
        &self,
        model: &MusculoskeletalModel,
        trial: &RecordedTrial,
        held: &HeldTrial,
    ) -> Result<Vec<PreparedTrial>, SimulationError> {
        let one = |v: &View| model.prepare_like(&trial.recording(&v.excitation), &trial.prepared, &self.options);
        held.views.iter().map(one).collect()
    }

    fn prepared_variants(
        &self,
        held: &HeldTrial,
        trial: &RecordedTrial,
        variants: &Option<Variants>,
    ) -> Result<Option<PreparedVariants>, SimulationError> {
        let Some(v) = variants else { return Ok(None) };
        let here = self.prepare(&v.here, trial, held)?;
        let sides = v
            .sides
            .iter()
            .map(|sides| {
                let Some([up, down]) = sides else { return Ok(None) };
                Ok(Some([self.prepare(up, trial, held)?, self.prepare(down, trial, held)?]))
            })
            .collect::<Result<_, SimulationError>>()?;
        Ok(Some(PreparedVariants { here, sides }))
    }

    fn unit_force(
        &self,
        held: &HeldTrial,
        variants: &Option<PreparedVariants>,
        muscle: usize,
        at: &DVector<f64>,
    ) -> Result<UnitForce, SimulationError> {
        let parameters = self.layout.parameters(muscle, &self.nominal[muscle], &|i| at[i]);
        let shapes = &self.layout.shapes[muscle];
        let samples = held.views[0].prepared.len();
        let mut force = vec![0.0; samples];
        let mut by: Vec<(usize, Vec<f64>)> = shapes.iter().map(|i| (*i, vec![0.0; samples])).collect();
        for (k, view) in held.views.iter().enumerate() {
            let prepared = variants.as_ref().map_or(&view.prepared, |v| &v.here[k]);
            let unit = prepared.unit_force_with_derivatives(muscle, &parameters)?;
            add(&mut force, view.weight, &unit.moment);
            for (i, by) in &mut by {
                let (series, scale) = match self.layout.free[*i].property {
                    MuscleProperty::OptimalFiberLength => {
                        (&unit.by_optimal_fiber_length, parameters.optimal_fiber_length)
                    }
                    MuscleProperty::TendonSlackLength => (&unit.by_tendon_slack_length, parameters.tendon_slack_length),
                    MuscleProperty::PennationAngle => (&unit.by_pennation_angle, parameters.pennation_angle_at_optimal),
                    _ => {
                        let Some([up, down]) = variants.as_ref().and_then(|v| v.sides[*i].as_ref()) else { continue };
                        let weight = view.weight / (2.0 * DIFFERENCE);
                        add(by, weight, &up[k].unit_force(muscle, &parameters)?);
                        add(by, -weight, &down[k].unit_force(muscle, &parameters)?);
                        continue;
                    }
                };
                add(by, view.weight * scale, series);
            }
        }
        Ok(UnitForce { force, by })
    }
}
