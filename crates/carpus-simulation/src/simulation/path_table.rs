//! Quantities that depend on one coordinate, tabulated over the range of a trial.
//!
//! In a prescribed trial only the dynamometer's coordinate moves (couplers follow it), so a muscle's path length and
//! moment arm are functions of one variable. They are evaluated at a few dozen angles instead of at every instant, and
//! interpolated by quartic polynomials on pieces that are halved until the polynomial predicts values it has not seen.

use super::piecewise::{locate, polynomial};
use super::single_jump::SingleJump;

/// Evaluations after which pieces are no longer halved: reached only around many discontinuities.
const MOST_EVALUATIONS: usize = 20_000;
/// Most pieces to start with, each of which takes eight evaluations: a joint turned by some hundred degrees takes a few
/// dozen.
const MOST_PIECES: f64 = 2_500.0;
/// A jump is located until its height, in tolerances, times the uncertainty of its place is below this [rad or m].
const PLACE_OF_JUMP: f64 = 1e-8;

/// How closely the table follows, per quantity, and how finely it may divide.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TableAccuracy<const N: usize> {
    /// Largest error at the check points, of each quantity.
    pub(crate) tolerance: [f64; N],
    /// Width of the pieces to start with.
    pub(crate) start_width: f64,
    /// Pieces are not made narrower than this.
    pub(crate) min_width: f64,
}

/// `N` functions of one variable.
#[derive(Clone, Debug)]
pub(crate) struct PathTable<const N: usize> {
    starts: Vec<f64>,
    /// Reciprocal width, and coefficients in the local coordinate 0…1, lowest power first.
    pieces: Vec<(f64, [[f64; 5]; N])>,
    evaluations: usize,
    discontinuities: Vec<f64>,
}

/// Values at five uniformly spaced points of a piece.
type Nodes<const N: usize> = [[f64; N]; 5];

struct Builder<'a, const N: usize, E> {
    function: &'a mut dyn FnMut(f64) -> Result<[f64; N], E>,
    accuracy: TableAccuracy<N>,
    table: PathTable<N>,
}

impl<const N: usize> PathTable<N> {
    /// Tabulates `function` on `range`.
    ///
    /// # Errors
    /// The first error of `function`.
    pub(crate) fn build<E>(
        range: [f64; 2],
        accuracy: TableAccuracy<N>,
        function: &mut dyn FnMut(f64) -> Result<[f64; N], E>,
    ) -> Result<PathTable<N>, E> {
        let [lower, upper] = range;
        // Rather a little wider than one piece more.
        let count = ((upper - lower) / accuracy.start_width - 0.05).ceil().clamp(1.0, MOST_PIECES) as usize;
        let width = (upper - lower) / count as f64;
        let table = PathTable { starts: Vec::new(), pieces: Vec::new(), evaluations: 0, discontinuities: Vec::new() };
        let mut builder = Builder { function, accuracy, table };
        let mut first = builder.evaluate(lower)?;
        for i in 0..count {
            let start = lower + width * i as f64;
            let mut nodes = [first; 5];
            for (k, node) in nodes.iter_mut().enumerate().skip(1) {
                *node = builder.evaluate(start + 0.25 * width * k as f64)?;
            }
            builder.refine(start, width, &nodes)?;
            first = nodes[4];
        }
        Ok(builder.table)
    }

    #[inline]
    fn piece(&self, x: f64, cursor: &mut usize) -> (usize, f64) {
        let i = locate(self.starts.len(), |i| self.starts[i], x, cursor);
        (i, (x - self.starts[i]) * self.pieces[i].0)
    }

    /// Value of quantity `K` at `x`; `cursor` remembers the piece. Beyond the range the outermost polynomial continues.
    #[inline]
    pub(crate) fn quantity<const K: usize>(&self, x: f64, cursor: &mut usize) -> f64 {
        let (i, t) = self.piece(x, cursor);
        polynomial(&self.pieces[i].1[K], t)
    }

    /// All quantities at `x`.
    pub(crate) fn values(&self, x: f64, cursor: &mut usize) -> [f64; N] {
        let (i, t) = self.piece(x, cursor);
        let coefficients = &self.pieces[i].1;
        std::array::from_fn(|n| polynomial(&coefficients[n], t))
    }

    /// Evaluations that building took.
    pub(crate) fn evaluations(&self) -> usize {
        self.evaluations
    }

    /// Where the function did not become smooth at the smallest width: it jumps there, or nearly so.
    pub(crate) fn discontinuities(&self) -> &[f64] {
        &self.discontinuities
    }
}

impl<const N: usize, E> Builder<'_, N, E> {
    fn evaluate(&mut self, x: f64) -> Result<[f64; N], E> {
        self.table.evaluations += 1;
        (self.function)(x)
    }

    /// Evaluates between the nodes; where the quartic through the nodes predicted well, keeps the two halves' quartics,
    /// else halves further.
    fn refine(&mut self, start: f64, width: f64, nodes: &Nodes<N>) -> Result<(), E> {
        let coefficients = fit(nodes);
        let mut between = [[0.0; N]; 4];
        let mut good = true;
        for (k, values) in between.iter_mut().enumerate() {
            let t = (k as f64 + 0.5) / 4.0;
            *values = self.evaluate(start + t * width)?;
            good &= (0..N).all(|n| (polynomial(&coefficients[n], t) - values[n]).abs() <= self.accuracy.tolerance[n]);
        }
        let half = 0.5 * width;
        let halves = [
            (start, [nodes[0], between[0], nodes[1], between[1], nodes[2]]),
            (start + half, [nodes[2], between[2], nodes[3], between[3], nodes[4]]),
        ];
        let exhausted = half < self.accuracy.min_width || self.table.evaluations > MOST_EVALUATIONS;
        let nine = std::array::from_fn(|k| if k % 2 == 0 { nodes[k / 2] } else { between[k / 2] });
        if !good && self.keep_with_jump(start, width, &nine)? {
            return Ok(());
        }
        if !good && exhausted {
            if let Some(jump) = self.locate_jump(start, width, &nine)? {
                return self.divide_at(start, start + width, jump);
            }
            self.table.discontinuities.push(start + half);
        }
        for (start, nodes) in halves {
            if good || exhausted {
                self.table.starts.push(start);
                self.table.pieces.push((1.0 / half, fit(&nodes)));
            } else {
                self.refine(start, half, &nodes)?;
            }
        }
        Ok(())
    }
}

impl<const N: usize, E> Builder<'_, N, E> {
    /// Largest difference of two values, in tolerances.
    fn distance(&self, a: &[f64; N], b: &[f64; N]) -> f64 {
        (0..N).map(|n| (a[n] - b[n]).abs() / self.accuracy.tolerance[n]).fold(0.0, f64::max)
    }

    /// Keeps a piece that is smooth but for one jump: the quartics of its halves with a step in one of them, without
    /// halving down to the jump. `false` if it is not so.
    ///
    /// - `values`: at the ninths of the piece
    fn keep_with_jump(&mut self, start: f64, width: f64, values: &[[f64; N]; 9]) -> Result<bool, E> {
        let tolerance = self.accuracy.tolerance;
        let Some(jump) = SingleJump::find(values, &tolerance) else { return Ok(false) };
        let gap = jump.gap;
        let lowered = |height: &[f64; N]| -> [[f64; N]; 9] {
            std::array::from_fn(|k| {
                std::array::from_fn(|n| if k > gap { values[k][n] - height[n] } else { values[k][n] })
            })
        };
        let every_second = |nine: &[[f64; N]; 9]| fit(&[nine[0], nine[2], nine[4], nine[6], nine[8]]);
        let before = every_second(&lowered(&jump.height));
        let height = self.distance(&jump.height, &[0.0; N]);
        let at = |k: usize| start + width * k as f64 / 8.0;
        let (mut low, mut high) = ((at(gap), values[gap]), (at(gap + 1), values[gap + 1]));
        while (high.0 - low.0) * height > PLACE_OF_JUMP {
            let x = 0.5 * (low.0 + high.0);
            if x <= low.0 || x >= high.0 {
                break;
            }
            let middle = self.evaluate(x)?;
            let below = before.map(|c| polynomial(&c, (x - start) / width));
            let above = std::array::from_fn(|n| below[n] + jump.height[n]);
            let [to_below, to_above] = [below, above].map(|side| self.distance(&middle, &side));
            if to_below.min(to_above) > 0.25 * height {
                return Ok(false);
            }
            if to_below < to_above { low = (x, middle) } else { high = (x, middle) }
        }
        let height: [f64; N] = std::array::from_fn(|n| high.1[n] - low.1[n]);
        let smooth = lowered(&height);
        let quartic = every_second(&smooth);
        let fits = |k: usize| {
            let t = k as f64 / 8.0;
            (0..N).all(|n| (polynomial(&quartic[n], t) - smooth[k][n]).abs() <= tolerance[n])
        };
        if ![1, 3, 5, 7].into_iter().all(fits) {
            return Ok(false);
        }
        let half = 0.5 * width;
        for (side, nodes) in [[0, 1, 2, 3, 4], [4, 5, 6, 7, 8]].into_iter().enumerate() {
            let from = start + half * side as f64;
            let jumps_here = gap / 4 == side;
            let coefficients = fit(&nodes.map(|k| if jumps_here { smooth[k] } else { values[k] }));
            self.table.starts.push(from);
            self.table.pieces.push((1.0 / half, coefficients));
            if jumps_here {
                let t = (high.0 - from) / half;
                let after = std::array::from_fn(|n| {
                    let mut c = shifted(&coefficients[n], t);
                    c[0] += height[n];
                    c
                });
                self.table.starts.push(high.0);
                self.table.pieces.push((1.0 / half, after));
                self.table.discontinuities.push(high.0);
            }
        }
        Ok(true)
    }

    /// The two neighbouring abscissae between which the function jumps, from its values at the ninths of a piece that
    /// no polynomial fits; `None` if it is continuous there.
    fn locate_jump(&mut self, start: f64, width: f64, values: &[[f64; N]; 9]) -> Result<Option<[f64; 2]>, E> {
        let rises: [f64; 8] = std::array::from_fn(|k| self.distance(&values[k], &values[k + 1]));
        let k = (0..8).max_by(|&a, &b| rises[a].total_cmp(&rises[b])).unwrap_or(0);
        // Where the function is only steep or has a kink, it rises elsewhere too.
        if (0..8).any(|i| i != k && rises[i] > 0.25 * rises[k]) {
            return Ok(None);
        }
        let at = |k: usize| start + width * k as f64 / 8.0;
        let (mut low, mut high) = ((at(k), values[k]), (at(k + 1), values[k + 1]));
        // The rise of a continuous function falls with every halving.
        while self.distance(&low.1, &high.1) > 1.0 {
            let x = 0.5 * (low.0 + high.0);
            if x <= low.0 || x >= high.0 {
                return Ok(Some([low.0, high.0]));
            }
            let middle = (x, self.evaluate(x)?);
            if self.distance(&low.1, &middle.1) > self.distance(&middle.1, &high.1) {
                high = middle
            } else {
                low = middle
            }
        }
        Ok(None)
    }

    /// A polynomial on each side of a jump.
    fn divide_at(&mut self, start: f64, end: f64, [low, high]: [f64; 2]) -> Result<(), E> {
        self.table.discontinuities.push(high);
        for [from, to] in [[start, low], [high, end]] {
            let width = to - from;
            // A side as narrow as rounding keeps to the outer neighbour's polynomial, or is constant.
            let flat = width < 1e-9 * self.accuracy.min_width;
            let mut nodes = [self.evaluate(if from == high { from } else { to })?; 5];
            if !flat {
                for (k, node) in nodes.iter_mut().enumerate() {
                    *node = self.evaluate(from + 0.25 * width * k as f64)?;
                }
            }
            self.table.starts.push(from);
            self.table.pieces.push((if flat { 0.0 } else { 1.0 / width }, fit(&nodes)));
        }
        Ok(())
    }
}

/// Coefficients of the quartics through values at 0, ¼, ½, ¾, 1.
fn fit<const N: usize>(nodes: &Nodes<N>) -> [[f64; 5]; N] {
    let mut out = [[0.0; 5]; N];
    for n in 0..N {
        let [f0, f1, f2, f3, f4] = [0, 1, 2, 3, 4].map(|k| nodes[k][n]);
        // Forward differences with step ¼, then powers of t.
        let d1 = f1 - f0;
        let d2 = f2 - 2.0 * f1 + f0;
        let d3 = f3 - 3.0 * f2 + 3.0 * f1 - f0;
        let d4 = f4 - 4.0 * f3 + 6.0 * f2 - 4.0 * f1 + f0;
        let (s1, s2, s3, s4) = (d1, d2 / 2.0, d3 / 6.0, d4 / 24.0);
        out[n] = [
            f0,
            4.0 * (s1 - s2 + 2.0 * s3 - 6.0 * s4),
            16.0 * (s2 - 3.0 * s3 + 11.0 * s4),
            64.0 * (s3 - 6.0 * s4),
            256.0 * s4,
        ];
    }
    out
}

/// The polynomial in t − `by`.
fn shifted(c: &[f64; 5], by: f64) -> [f64; 5] {
    let mut c = *c;
    for i in 0..4 {
        for k in (i..4).rev() {
            c[k] += by * c[k + 1];
        }
    }
    c
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_small_jumps_of_a_smooth_function_cost_little() {
        // As loose iterations in wrapping make them: a fraction of what the function changes otherwise.
        let jumps = [(-0.43, 1e-6), (0.211, -3e-7), (0.214, 2e-5)];
        let step = |x: f64| jumps.iter().map(|&(at, height)| if x >= at { height } else { 0.0 }).sum::<f64>();
        let f = |x: f64| 0.3 + 0.02 * x + 0.004 * (2.0 * x).sin() + step(x);
        let table = build([-0.6, 0.6], f);
        let mut cursor = 0;
        for i in 0..20_000 {
            let x = -0.6 + 1.2 * f64::from(i) / 20_000.0;
            assert!((table.quantity::<0>(x, &mut cursor) - f(x)).abs() < 1e-8, "{x}");
        }
        for (place, height) in jumps {
            let found = table.discontinuities().iter().map(|d| (d - place).abs()).fold(1.0, f64::min);
            assert!(found * height.abs() < 1e-15, "{place}: {found:e}");
        }
        assert!(table.evaluations() < 350, "{}", table.evaluations());
    }

    #[test]
    fn verif_work_does_not_grow_with_the_range() {
        for range in [[0.0, 1e12], [-1e300, 1e300]] {
            let table = build(range, |x| 0.3 + 1e-3 * (x / 1e11).sin());
            let most = MOST_EVALUATIONS + 10 * MOST_PIECES as usize;
            assert!(table.evaluations() < most, "{range:?}: {}", table.evaluations());
        }
    }

    fn accuracy(tolerance: f64) -> TableAccuracy<1> {
        TableAccuracy { tolerance: [tolerance], start_width: 0.2, min_width: 1e-5 }
    }

    fn build(range: [f64; 2], f: impl Fn(f64) -> f64) -> PathTable<1> {
        let mut function = |x: f64| Ok::<_, ()>([f(x)]);
        PathTable::build(range, accuracy(1e-8), &mut function).unwrap()
    }

    #[test]
    fn verif_quartics_reproduce_a_quartic() {
        let f = |x: f64| 1.0 - 2.0 * x + 0.5 * x * x - 3.0 * x.powi(3) + 0.7 * x.powi(4);
        let table = build([-0.3, 0.5], f);
        let mut cursor = 0;
        for i in 0..50 {
            let x = -0.3 + 0.016 * i as f64;
            assert!((table.values(x, &mut cursor)[0] - f(x)).abs() < 1e-13);
        }
        assert!(table.discontinuities().is_empty());
    }

    #[test]
    fn verif_table_meets_its_tolerance_where_curvature_jumps() {
        // Wrapping starts: value and slope are continuous, curvature is not.
        let f = |x: f64| 0.3 + 0.02 * x + if x > 0.1234 { 0.5 * (x - 0.1234).powi(2) } else { 0.0 };
        let table = build([-0.6, 0.6], f);
        let mut cursor = 0;
        let worst = (0..20_000)
            .map(|i| -0.6 + 1.2 * i as f64 / 20_000.0)
            .map(|x| (table.quantity::<0>(x, &mut cursor) - f(x)).abs())
            .fold(0.0, f64::max);
        assert!(worst < 1e-8, "{worst:e}");
        assert!(table.evaluations() < 300, "{}", table.evaluations());
    }

    #[test]
    fn verif_jumps_are_found_to_rounding_and_reported() {
        // On both sides of the jump the function is curved.
        let f = |x: f64| if x < 0.317 { 0.3 * x * x } else { 1.0 - x * x };
        let table = build([0.0, 1.0], f);
        let mut cursor = 0;
        for x in [0.0, 0.2, 0.316_9, 0.317 - 1e-12, 0.317, 0.317 + 1e-12, 0.317_1, 0.5, 1.0] {
            let value = table.values(x, &mut cursor)[0];
            assert!((value - f(x)).abs() < 1e-8, "{x}: {value} instead of {}", f(x));
        }
        let [at] = table.discontinuities() else { panic!("{:?}", table.discontinuities()) };
        assert!((at - 0.317).abs() < 1e-15, "{at}");
    }

    #[test]
    fn verif_errors_of_the_function_are_passed_on() {
        let mut function = |x: f64| if x > 0.5 { Err("too far") } else { Ok([x]) };
        assert_eq!(PathTable::build([0.0, 1.0], accuracy(1e-8), &mut function).err(), Some("too far"));
    }
}
