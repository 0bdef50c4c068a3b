//! What the couplers of a model do to coordinates and their rates.

use super::coupler::Coupler;
use super::model::Model;
use carpus_osim::functions::Function;
use carpus_osim::osim::spec::CoordinateIndex;

impl Model {
    /// Sets every dependent coordinate to the value that its coupler gives.
    ///
    /// - `q`: coordinates [rad or m], length `n_coordinates`
    pub fn satisfy_couplers(&self, q: &mut [f64]) {
        for coupler in &self.couplers {
            q[coupler.dependent.0] = coupler.value(q);
        }
    }

    /// The same model, in which further coordinates follow an independent one by functions.
    ///
    /// - `followers`: coordinates that no coupler drives
    pub fn with_followers(mut self, of: CoordinateIndex, followers: Vec<(CoordinateIndex, Function)>) -> Model {
        // Before all others: couplers may have them for arguments.
        let named = followers.into_iter().map(|(dependent, function)| {
            let name = format!("loop through {}", self.coordinates[dependent.0].name);
            Coupler::by_function(name, of, dependent, function)
        });
        self.couplers = named.chain(std::mem::take(&mut self.couplers)).collect();
        for (i, coupler) in self.couplers.iter().enumerate() {
            self.driven_by[coupler.dependent.0] = Some(i);
        }
        self
    }

    /// Default values of all coordinates [rad or m], couplers satisfied.
    pub fn default_coordinates(&self) -> Vec<f64> {
        let mut q: Vec<f64> = self.coordinates.iter().map(|c| c.default_value).collect();
        self.satisfy_couplers(&mut q);
        q
    }

    /// Whether a coupler determines the coordinate.
    pub fn is_dependent(&self, coordinate: CoordinateIndex) -> bool {
        self.driver_of(coordinate).is_some()
    }

    /// The coupler that determines the coordinate.
    pub fn driver_of(&self, coordinate: CoordinateIndex) -> Option<&Coupler> {
        self.driven_by[coordinate.0].map(|i| &self.couplers[i])
    }

    /// Whether chains of couplers start at one coordinate and lead to both of two.
    pub fn are_coupled(&self, a: CoordinateIndex, b: CoordinateIndex) -> bool {
        let roots = self.roots_of(a);
        self.roots_of(b).iter().any(|root| roots.contains(root))
    }

    /// The independent coordinates at the start of a coordinate's chains of couplers, each once (itself, if not
    /// dependent).
    pub fn roots_of(&self, coordinate: CoordinateIndex) -> Vec<CoordinateIndex> {
        let (mut roots, mut seen, mut left) = (Vec::new(), Vec::new(), vec![coordinate]);
        while let Some(next) = left.pop() {
            if seen.contains(&next) {
                continue;
            }
            seen.push(next);
            match self.driver_of(next) {
                Some(coupler) => left.extend(coupler.independent.iter().rev().copied()),
                None => roots.push(next),
            }
        }
        roots
    }

    /// Names of [`Model::roots_of`] in a sentence, with a mark around each.
    pub fn names_of_roots(&self, coordinate: CoordinateIndex, mark: &str) -> String {
        let name = |root: &CoordinateIndex| format!("{mark}{}{mark}", self.coordinates[root.0].name);
        self.roots_of(coordinate).iter().map(name).collect::<Vec<_>>().join(" and ")
    }

    /// Coupling vector: rate of every coordinate for unit rate of coordinate `c`, couplers followed, all other
    /// independent coordinates at rest.
    ///
    /// If `c` itself is dependent, the coordinates that drive it move along, each in proportion to what it does (as in
    /// OpenSim's `MomentArmSolver`); the result is not finite where its coupling function is flat.
    ///
    /// - `q`: coordinates [rad or m], couplers satisfied
    /// - `coupling`: receives dqᵢ/dq_c, length `n_coordinates`
    pub fn update_coupling(&self, q: &[f64], c: CoordinateIndex, coupling: &mut [f64]) {
        coupling.fill(0.0);
        let mut root_rate = 1.0;
        let mut root = c;
        while let Some(coupler) = self.driver_of(root) {
            let Some(argument) = coupler.only_argument() else { return self.couple_several(q, c, coupling) };
            root_rate /= coupler.derivative(q, 0);
            root = argument;
        }
        coupling[root.0] = root_rate;
        self.follow_couplers(q, coupling);
        coupling[c.0] = 1.0;
    }

    /// [`Model::update_coupling`] for a coordinate that several others drive: their rates are the smallest that do.
    fn couple_several(&self, q: &[f64], c: CoordinateIndex, coupling: &mut [f64]) {
        let roots = self.roots_of(c);
        let slope = |root: &CoordinateIndex| {
            let mut rates = vec![0.0; q.len()];
            rates[root.0] = 1.0;
            self.follow_couplers(q, &mut rates);
            rates[c.0]
        };
        let slopes: Vec<f64> = roots.iter().map(slope).collect();
        let squares: f64 = slopes.iter().map(|slope| slope * slope).sum();
        roots.iter().zip(&slopes).for_each(|(root, slope)| coupling[root.0] = slope / squares);
        self.follow_couplers(q, coupling);
        coupling[c.0] = 1.0;
    }

    /// Allocating form of [`Model::update_coupling`].
    pub fn coupling(&self, q: &[f64], c: CoordinateIndex) -> Vec<f64> {
        let mut coupling = vec![0.0; self.n_coordinates()];
        self.update_coupling(q, c, &mut coupling);
        coupling
    }

    /// Sets the rate of every dependent coordinate from those of the coordinates that drive it.
    ///
    /// - `q`: coordinates [rad or m], couplers satisfied
    /// - `qdot`: rates [rad/s or m/s]; those of dependent coordinates are overwritten
    pub fn follow_couplers(&self, q: &[f64], qdot: &mut [f64]) {
        for coupler in &self.couplers {
            qdot[coupler.dependent.0] = coupler.rate(q, qdot);
        }
    }

    /// Sets the second rate of every dependent coordinate:
    /// `q̈_d = Σ f_k(q)·q̈_k + Σ f_kl(q)·q̇_k·q̇_l`.
    ///
    /// - `qddot`: second rates [rad/s² or m/s²]; those of dependent coordinates are overwritten
    pub fn follow_couplers_second(&self, q: &[f64], qdot: &[f64], qddot: &mut [f64]) {
        for coupler in &self.couplers {
            let by_second = coupler.derivatives(q).fold(0.0, |sum, (i, slope)| sum + slope * qddot[i.0]);
            qddot[coupler.dependent.0] = by_second + coupler.second_rate_at_constant_rates(q, qdot);
        }
    }
}
