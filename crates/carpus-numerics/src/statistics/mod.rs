//! Statistics of studies in which every participant is measured under every condition, and of agreement between two
//! methods of measurement.
//!
//! In: numbers, one row a participant or one pair a measurement. Out: test statistics, p-values, intervals and sample
//! sizes. Nothing is read or printed here, and no test chooses itself: corrections (sphericity, multiple comparisons)
//! are always reported beside the uncorrected value.
//!
//! | question | module |
//! |---|---|
//! | do conditions differ? | [`RepeatedMeasures`]: ANOVA, Mauchly's test, Greenhouse–Geisser and Huynh–Feldt |
//! | which conditions differ? | [`paired_t_test`], [`pairwise_comparisons`] with Bonferroni's correction |
//! | do two quantities go together? | [`pearson`], [`linear_regression`] |
//! | do two methods agree? | [`bland_altman`] |
//! | do groups differ, or the same persons before and after? | [`mixed_model`], [`holm`] |
//! | what do fits of some persons say about the next? | [`population`] |
//! | could this many participants have shown it? | [`PowerAnalysis`] |

mod agreement;
mod anova;
mod correlation;
mod distributions;
mod error;
mod mixed_model;
mod pairwise;
mod population;
mod power;
mod quadrature;
mod sphericity;

pub use agreement::{Agreement, bland_altman};
pub use anova::{Effect, Factor, RepeatedMeasures};
pub use correlation::{Correlation, LinearRegression, linear_regression, pearson};
pub use distributions::{
    chi_squared_tail, f_tail, noncentral_t_cdf, normal_cdf, normal_of_uniform, normal_quantile, t_cdf, t_quantile,
    t_two_sided,
};
pub use error::StatisticsError;
pub use mixed_model::{Contrast, MixedModel, holm, mixed_model};
pub use pairwise::{Comparison, PairedT, bonferroni, paired_t_test, pairwise_comparisons};
pub use population::{Evidence, Population, population};
pub use power::{PowerAnalysis, Tails, TestDesign};
pub use sphericity::Sphericity;
