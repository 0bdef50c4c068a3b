//! Whether EMG channels of two muscles were exchanged: each is most active in efforts of the other's direction.

use super::Study;
use super::efforts::{flexion_sign, regression, sums_of_products};
use super::fault::Fault;
use super::problem::Problem;
use super::trial::Trial;
use super::trial_list::Direction;

/// A channel is most active in the wrong direction from this ratio of mean excitations on: antagonists that hold a
/// joint
/// stiff stay below it.
const CLEARLY_MORE: f64 = 1.5;

/// A column of EMG and the muscles that it drives.
struct Channel {
    /// Positions among the active muscles.
    muscles: Vec<usize>,
    /// Mean over all samples of its muscles' moments at full activation [N·m].
    mean_strength: f64,
}

impl Study {
    /// Looks for EMG channels that were exchanged between a muscle of one side of the joint and one of the other.
    ///
    /// - `trials`: a participant's
    /// - `strengths`: per trial, active muscle and sample, moment arm times maximum isometric force [N·m]
    pub fn check_channels(&self, trials: &[Trial], strengths: &[Vec<Vec<f64>>]) -> Vec<Problem> {
        let Some(flexion) = flexion_sign(&self.settings) else { return Vec::new() };
        let channels = self.channels(strengths);
        let both = |mvc: bool| {
            let has = |d| trials.iter().any(|t| t.info.direction == d && (!mvc || t.info.is_mvc()));
            has(Direction::Flexion) && has(Direction::Extension)
        };
        // Maximum efforts say most; without both, all efforts count.
        let only_mvc = both(true);
        if !only_mvc && !both(false) {
            return Vec::new();
        }
        let activity = |channel: &Channel, direction: Direction| {
            let of = trials.iter().filter(|t| t.info.direction == direction && (!only_mvc || t.info.is_mvc()));
            let means: Vec<f64> = of.map(|t| mean(&t.excitation[channel.muscles[0]])).collect();
            mean(&means)
        };
        let is_wrong = |channel: &Channel| {
            let [along, against] = if channel.mean_strength * flexion > 0.0 {
                [Direction::Flexion, Direction::Extension]
            } else {
                [Direction::Extension, Direction::Flexion]
            };
            activity(channel, against) > CLEARLY_MORE * activity(channel, along)
        };
        let mut wrong: Vec<&Channel> = channels.iter().filter(|channel| is_wrong(channel)).collect();
        let mut problems = Vec::new();
        loop {
            let sides = |a: &Channel, b: &Channel| a.mean_strength * b.mean_strength < 0.0;
            let pairs = (0..wrong.len()).flat_map(|i| (0..i).map(move |j| (j, i)));
            let gain = |(i, j): (usize, usize)| self.fit_gain(trials, strengths, &channels, [wrong[i], wrong[j]]);
            let best = pairs
                .filter(|&(i, j)| sides(wrong[i], wrong[j]))
                .map(|pair| (pair, gain(pair)))
                .max_by(|a, b| a.1.unwrap_or(0.0).total_cmp(&b.1.unwrap_or(0.0)));
            let Some(((i, j), gain)) = best else { return problems };
            let name = |channel: &Channel| {
                let names: Vec<&str> =
                    channel.muscles.iter().map(|m| self.settings.active_muscles[*m].as_str()).collect();
                names.join(" and ")
            };
            let fault = Fault::ChannelsExchanged {
                first: name(wrong[i]),
                second: name(wrong[j]),
                fit_gain: gain.filter(|gain| *gain > 1.0),
            };
            problems.push(Problem::warning(&self.file, self.settings.active_line, fault));
            wrong.remove(j);
            wrong.remove(i);
        }
    }

    fn channels(&self, strengths: &[Vec<Vec<f64>>]) -> Vec<Channel> {
        let columns = &self.settings.columns.emg;
        let mut channels: Vec<Channel> = Vec::new();
        for first in (0..columns.len()).filter(|i| !columns[..*i].contains(&columns[*i])) {
            let muscles: Vec<usize> = (0..columns.len()).filter(|i| columns[*i] == columns[first]).collect();
            let means = strengths.iter().map(|trial| muscles.iter().map(|m| mean(&trial[*m])).sum());
            let mean_strength = mean(&means.collect::<Vec<f64>>());
            channels.push(Channel { muscles, mean_strength });
        }
        channels
    }

    /// RMS error of the moment as a multiple of Σ excitation · strength beside a quadratic of the angle, over that with
    /// two
    /// channels exchanged.
    fn fit_gain(
        &self,
        trials: &[Trial],
        strengths: &[Vec<Vec<f64>>],
        channels: &[Channel],
        exchanged: [&Channel; 2],
    ) -> Option<f64> {
        let source = |channel: &Channel, exchange: bool| {
            let of = |c: &Channel| c.muscles[0];
            match exchanged.iter().position(|e| of(e) == of(channel)).filter(|_| exchange) {
                Some(place) => of(exchanged[1 - place]),
                None => of(channel),
            }
        };
        let left = |exchange: bool| {
            let predicted = |t: usize, k: usize| -> f64 {
                let of = |c: &Channel| {
                    let strength: f64 = c.muscles.iter().map(|m| strengths[t][*m][k]).sum();
                    strength * trials[t].excitation[source(c, exchange)][k]
                };
                channels.iter().map(of).sum()
            };
            let sums = sums_of_products(trials, predicted);
            regression(&sums, &[0, 1, 2, 3]).or_else(|| regression(&sums, &[0, 3])).map(|(left, _)| left)
        };
        let (before, after) = (left(false)?, left(true)?);
        (after > 0.0).then(|| (before / after).max(0.0).sqrt())
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}
