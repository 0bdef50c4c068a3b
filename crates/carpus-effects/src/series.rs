//! A series at other times than its own.

/// A series as it was so much earlier, at the same times; linear between samples and constant outside. An empty one
/// stays empty.
pub(crate) fn delayed(time: &[f64], series: &[f64], delay: f64) -> Vec<f64> {
    if series.is_empty() {
        return Vec::new();
    }
    let mut after = 0;
    let at = |t: &f64| {
        let at = t - delay;
        while after < time.len() && time[after] <= at {
            after += 1;
        }
        between(time, series, after, at)
    };
    time.iter().map(at).collect()
}

/// Value of a series at a time, linear between samples and constant outside.
pub fn interpolate(time: &[f64], series: &[f64], at: f64) -> f64 {
    between(time, series, time.partition_point(|t| *t <= at), at)
}

/// - `after`: the first sample after `at`
fn between(time: &[f64], series: &[f64], after: usize, at: f64) -> f64 {
    let last = time.len() - 1;
    if at <= time[0] {
        return series[0];
    }
    if at >= time[last] {
        return series[last];
    }
    let i = after.clamp(1, last) - 1;
    let part = (at - time[i]) / (time[i + 1] - time[i]);
    series[i] + part * (series[i + 1] - series[i])
}
