//! Self-contained HTML reports, pure functions of results files.
//!
//! In: [`results::Results`] (the content of a `results.json`) or, for path sweeps, a [`sweep::SweepFigure`]. Out: the
//! text of one HTML page that needs no network: styles and script are inline and named by hash in a strict content
//! security policy, figures are SVG drawn here. Nothing in this module reads files, the clock or the environment.

pub mod article;
mod axis_figures;
pub mod bars;
pub mod convergence;
pub mod diagnosis;
pub mod identifiability;
pub mod identifiability_page;
pub mod intervals;
pub mod ledger;
pub mod live;
pub mod model_page;
pub mod moments;
pub mod muscle_use;
pub mod next_steps;
mod number;
mod page;
mod plot;
mod policy;
pub mod residuals;
pub mod results;
mod sentence;
pub mod signals;
mod story;
mod story_figures;
pub mod sweep;
mod torque_angle;
pub mod ultrasound;
mod view;
mod warnings;

pub use article::render_article;
pub use axis_figures::axis_name;
pub use number::{percent, plain, quantity, significant};
pub use page::{render_report, render_waterfall};
pub use signals::render_signals;
pub use sweep::render_sweep;
