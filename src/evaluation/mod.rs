//! Error measures between measured and simulated moments, per trial and per condition.
