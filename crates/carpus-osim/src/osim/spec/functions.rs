//! OpenSim's functions.

/// A function of one argument (or of several, for polynomials OpenSim may nest).
#[derive(Clone, Debug, PartialEq)]
pub enum FunctionSpec {
    /// `Constant`.
    Constant {
        /// The value.
        value: f64,
    },
    /// `LinearFunction`: slope·x + intercept.
    Linear {
        /// Slope.
        slope: f64,
        /// Intercept.
        intercept: f64,
    },
    /// `SimmSpline` (also `natCubicSpline`, `NaturalCubicSpline` of old files).
    SimmSpline {
        /// Abscissae.
        x: Vec<f64>,
        /// Ordinates.
        y: Vec<f64>,
    },
    /// `PiecewiseLinearFunction`.
    PiecewiseLinear {
        /// Abscissae.
        x: Vec<f64>,
        /// Ordinates.
        y: Vec<f64>,
    },
    /// `PiecewiseConstantFunction` and `StepFunction` of old files.
    PiecewiseConstant {
        /// Abscissae.
        x: Vec<f64>,
        /// Ordinates.
        y: Vec<f64>,
    },
    /// `StepFunction`: smooth step between two values.
    Step {
        /// Start of the transition.
        start_time: f64,
        /// End of the transition.
        end_time: f64,
        /// Value before.
        start_value: f64,
        /// Value after.
        end_value: f64,
    },
    /// `GCVSpline` of degree 1, 3, 5 or 7.
    GcvSpline {
        /// (degree + 1) / 2.
        half_order: usize,
        /// Error variance; negative: estimated.
        error_variance: f64,
        /// Abscissae.
        x: Vec<f64>,
        /// Ordinates.
        y: Vec<f64>,
        /// Weights.
        weights: Vec<f64>,
    },
    /// `PolynomialFunction`, highest power first.
    Polynomial {
        /// Coefficients, highest power first.
        coefficients: Vec<f64>,
    },
    /// `MultivariatePolynomialFunction`, and `LinearFunction` of several variables.
    MultivariatePolynomial {
        /// Number of variables.
        dimension: usize,
        /// Largest sum of powers in a term.
        order: usize,
        /// Coefficients of the terms; powers of the last variable change first, lowest first.
        coefficients: Vec<f64>,
    },
    /// `ExpressionBasedFunction`: a formula.
    ExpressionBased {
        /// The formula.
        expression: String,
        /// Names of its variables, in the order of the arguments.
        variables: Vec<String>,
    },
    /// `MultiplierFunction`.
    Multiplier {
        /// Factor.
        scale: f64,
        /// The function that is scaled.
        function: Box<FunctionSpec>,
    },
    /// `Sine`: amplitude·sin(omega·x + phase) + offset.
    Sine {
        /// Amplitude.
        amplitude: f64,
        /// Angular frequency.
        omega: f64,
        /// Phase [rad].
        phase: f64,
        /// Offset.
        offset: f64,
    },
}
