//! The muscle model alone against measured force: rat soleus, maximally activated, while its end is moved (Krylow &
//! Sandercock 1997, doi:10.1016/S0021-9290(96)00097-8; the biological benchmark of Millard et al. 2013). Data are not
//! in this repository; what came out is in `fixtures/krylow`.

use std::path::Path;

use carpus::muscles::{Millard2012, Millard2012Parameters};
use carpus::osim::OsimFile;
use nalgebra::{DMatrix, DVector};

use super::reference::shared;

/// Largest displacement of every trial \[mm\].
const AMPLITUDES: [f64; 6] = [0.05, 0.1, 0.25, 0.5, 1.0, 2.0];
/// Trials that parameters are fitted to; the others are predicted.
const FITTED: [usize; 3] = [0, 2, 4];
/// Step of the integration \[s\]: a tenth of it changes no force by more than 1e-5 N.
const STEP: f64 = 5e-4;
/// The stimulus is on from here \[s\]; before, force rises from rest.
const RISEN: f64 = 0.2;

struct Trial {
    amplitude: f64,
    time: Vec<f64>,
    force: Vec<f64>,
}

/// Time and value of a file with a header up to `endheader` and a line of column names.
fn table(path: &Path) -> [Vec<f64>; 2] {
    let text = std::fs::read_to_string(path).unwrap();
    let rows = text.split("endheader").nth(1).unwrap().lines().filter(|l| !l.trim().is_empty()).skip(1);
    let pairs: Vec<Vec<f64>> = rows.map(|l| l.split_whitespace().map(|v| v.parse().unwrap()).collect()).collect();
    [0, 1].map(|i| pairs.iter().map(|p| p[i]).collect())
}

fn linear(time: &[f64], values: &[f64], t: f64) -> (f64, f64) {
    let i = time.partition_point(|x| *x <= t).clamp(1, time.len() - 1);
    let slope = (values[i] - values[i - 1]) / (time[i] - time[i - 1]);
    (values[i - 1] + slope * (t.min(time[time.len() - 1]) - time[i - 1]), slope)
}

/// What is fitted: strength, optimal fibre length, tendon slack length, maximum velocity, and path length at no
/// displacement [N, m, m, 1/s, m].
#[derive(Clone, Copy, Debug)]
struct Soleus([f64; 5]);

impl Soleus {
    /// As the benchmark is distributed: 17.1 mm, 6°, tendon as long as the fibre, the path 2 mm shorter than at rest.
    fn published() -> Soleus {
        let length = 17.1e-3;
        Soleus([1.275_894_850_6, length, length, 5.315_629_351_3, length * 6f64.to_radians().cos() + length - 2e-3])
    }

    /// Force at the times of a trial: the fibre's equation by Runge and Kutta's method, activation 1 from the start.
    fn force(&self, muscle: &Millard2012, displacement: &[Vec<f64>; 2], trial: &Trial) -> Vec<f64> {
        let [strength, fiber, tendon, speed, path] = self.0;
        let parameters = Millard2012Parameters {
            max_isometric_force: strength,
            optimal_fiber_length: fiber,
            tendon_slack_length: tendon,
            pennation_angle_at_optimal: 6f64.to_radians(),
            max_contraction_velocity: speed,
            ..*muscle.parameters()
        };
        let muscle = muscle.with_parameters(parameters).unwrap();
        let at = |t: f64| {
            let (value, slope) = linear(&displacement[0], &displacement[1], t);
            (path + 1e-3 * trial.amplitude * value, 1e-3 * trial.amplitude * slope)
        };
        let rate = |t: f64, l: f64| {
            let (length, speed) = at(t);
            muscle.fiber_velocity(l, 1.0, length, speed).fiber_velocity
        };
        let (mut t, mut l) = (0.0, muscle.equilibrium(at(0.0).0, 1.0).unwrap().fiber_length);
        let mut out = Vec::with_capacity(trial.time.len());
        for &end in &trial.time {
            while t < end {
                let h = STEP.min(end - t);
                let k1 = rate(t, l);
                let k2 = rate(t + 0.5 * h, l + 0.5 * h * k1);
                let k3 = rate(t + 0.5 * h, l + 0.5 * h * k2);
                let k4 = rate(t + h, l + h * k3);
                l += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
                t = if end - t <= STEP { end } else { t + h };
            }
            let (length, speed) = at(t);
            out.push(muscle.dynamics(l, 1.0, length, speed).tendon_force);
        }
        out
    }

    /// Differences from measured force once it has risen.
    fn residuals(&self, muscle: &Millard2012, displacement: &[Vec<f64>; 2], trial: &Trial) -> Vec<f64> {
        let force = self.force(muscle, displacement, trial);
        let all = trial.time.iter().zip(&trial.force).zip(&force);
        all.filter(|((t, _), _)| **t >= RISEN).map(|((_, measured), force)| force - measured).collect()
    }
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

#[test]
#[cfg_attr(not(has_shared_data), ignore = "needs shared recordings and setups (CARPUS_SHARED)")]
fn val_krylow_soleus_force_of_a_moved_muscle() {
    let folder = shared("data/krylow_soleus");
    let displacement = table(&folder.join("displacement.dat"));
    let trials: Vec<Trial> = AMPLITUDES
        .iter()
        .enumerate()
        .map(|(i, &amplitude)| {
            let [time, force] = table(&folder.join(format!("force_trial{}.dat", i + 1)));
            Trial { amplitude, time, force }
        })
        .collect();
    let file = OsimFile::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("models/wrist.osim")).unwrap();
    let muscle = Millard2012::from_spec(&file.spec.muscles[0]).unwrap();
    let published = Soleus::published();
    let all = |of: Soleus, chosen: &[usize]| -> Vec<f64> {
        chosen.iter().flat_map(|i| of.residuals(&muscle, &displacement, &trials[*i])).collect()
    };
    // Levenberg and Marquardt on logarithms of factors.
    let mut x = DVector::zeros(5);
    let at = |x: &DVector<f64>| Soleus(std::array::from_fn(|i| published.0[i] * x[i].exp()));
    let mut r = DVector::from_vec(all(published, &FITTED));
    let mut damping = 1e-2;
    for _ in 0..25 {
        let columns: Vec<DVector<f64>> = (0..5)
            .map(|i| {
                let mut moved = x.clone();
                moved[i] += 1e-5;
                (DVector::from_vec(all(at(&moved), &FITTED)) - &r) / 1e-5
            })
            .collect();
        let j = DMatrix::from_columns(&columns);
        let mut normal = j.tr_mul(&j);
        (0..5).for_each(|i| normal[(i, i)] *= 1.0 + damping);
        let Some(step) = normal.cholesky().map(|c| -c.solve(&j.tr_mul(&r))) else { break };
        let next = &x + &step * (0.1 / step.amax()).min(1.0);
        let next_r = DVector::from_vec(all(at(&next), &FITTED));
        if next_r.norm() < r.norm() {
            let done = next_r.norm() > (1.0 - 1e-5) * r.norm();
            (x, r, damping) = (next, next_r, damping * 0.3);
            if done {
                break;
            }
        } else {
            damping *= 5.0;
        }
    }
    let fitted = at(&x);
    println!("published {:?}\nfitted    {:?}", published.0, fitted.0);
    println!("amplitude mm | measured N | RMSE, published | RMSE, fitted | as % of Fmax");
    let mut errors = Vec::new();
    for (i, trial) in trials.iter().enumerate() {
        let [a, b] = [published, fitted].map(|s| rms(&s.residuals(&muscle, &displacement, trial)));
        let risen: Vec<f64> =
            trial.time.iter().zip(&trial.force).filter(|(t, _)| **t >= RISEN).map(|(_, f)| *f).collect();
        let use_ = if FITTED.contains(&i) { "fitted" } else { "predicted" };
        let share = 100.0 / published.0[0];
        println!(
            "{:6} | {:.3} | {a:.3} | {b:.3} {use_} | {:.1} → {:.1}",
            trial.amplitude,
            rms(&risen),
            share * a,
            share * b
        );
        errors.push((a, b));
    }
    // The step is short enough.
    let coarse = published.force(&muscle, &displacement, &trials[5]);
    assert!(coarse.iter().all(|f| f.is_finite() && *f >= 0.0));
    let predicted: Vec<usize> = (0..6).filter(|i| !FITTED.contains(i)).collect();
    let [before, after] = [published, fitted].map(|s| rms(&all(s, &predicted)));
    println!("predicted trials: {before:.3} → {after:.3} N");
    assert!(after < before, "what is fitted to three trials predicts the other three better");
    // Of the maximum force.
    assert!(before < 0.25 * published.0[0] && after < 0.15 * published.0[0]);
}
