//! Quantities that depend on one coordinate, tabulated over the range of a trial.
//!
//! In a prescribed trial only the dynamometer's coordinate moves (couplers follow it), so a muscle's path length and
//! moment arm are functions of one variable. They are evaluated at a few dozen angles instead of at every instant, and
//! interpolated by quartic polynomials on pieces that are halved until the polynomial predicts values it has not seen.

/// Evaluations after which pieces are no longer halved: reached only around many discontinuities.
const MOST_EVALUATIONS: usize = 20_000;

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
        let count = ((upper - lower) / accuracy.start_width).ceil().max(1.0) as usize;
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

    fn piece(&self, x: f64, cursor: &mut usize) -> (usize, f64) {
        let mut i = (*cursor).min(self.starts.len() - 1);
        if x < self.starts[i] || self.starts.get(i + 1).is_some_and(|&next| x >= next) {
            i = self.starts.partition_point(|&s| s <= x).saturating_sub(1);
            *cursor = i;
        }
        (i, (x - self.starts[i]) * self.pieces[i].0)
    }

    /// Value of quantity `K` at `x`; `cursor` remembers the piece. Beyond the range the outermost polynomial continues.
    #[inline]
    pub(crate) fn quantity<const K: usize>(&self, x: f64, cursor: &mut usize) -> f64 {
        let (i, t) = self.piece(x, cursor);
        quartic(&self.pieces[i].1[K], t)
    }

    /// All quantities at `x`.
    pub(crate) fn values(&self, x: f64, cursor: &mut usize) -> [f64; N] {
        let (i, t) = self.piece(x, cursor);
        self.pieces[i].1.map(|coefficients| quartic(&coefficients, t))
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
            good &= (0..N).all(|n| (quartic(&coefficients[n], t) - values[n]).abs() <= self.accuracy.tolerance[n]);
        }
        let half = 0.5 * width;
        let halves = [
            (start, [nodes[0], between[0], nodes[1], between[1], nodes[2]]),
            (start + half, [nodes[2], between[2], nodes[3], between[3], nodes[4]]),
        ];
        let exhausted = half < self.accuracy.min_width || self.table.evaluations > MOST_EVALUATIONS;
        if !good && exhausted {
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

fn quartic(c: &[f64; 5], t: f64) -> f64 {
    c[0] + t * (c[1] + t * (c[2] + t * (c[3] + t * c[4])))
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

#[cfg(test)]
mod tests {
    use super::*;

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
    fn verif_jumps_are_confined_and_reported() {
        let table = build([0.0, 1.0], |x| if x < 0.317 { 0.0 } else { 1.0 });
        let mut cursor = 0;
        assert!(table.values(0.316_9, &mut cursor)[0].abs() < 1e-12);
        assert!((table.values(0.317_1, &mut cursor)[0] - 1.0).abs() < 1e-12);
        assert!(!table.discontinuities().is_empty());
        assert!(table.discontinuities().iter().all(|x| (x - 0.317).abs() < 1e-4));
    }

    #[test]
    fn verif_errors_of_the_function_are_passed_on() {
        let mut function = |x: f64| if x > 0.5 { Err("too far") } else { Ok([x]) };
        assert_eq!(PathTable::build([0.0, 1.0], accuracy(1e-8), &mut function).err(), Some("too far"));
    }
}
