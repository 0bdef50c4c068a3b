//! A formula, and the text of an effect of one's own.

/// A term of a formula.
#[derive(Clone, Debug, PartialEq)]
pub struct ProposedTerm {
    /// The term, `k` its shape.
    pub term: String,
    /// Its coefficient.
    pub coefficient: f64,
    /// Unit of the coefficient.
    pub unit: String,
    /// The shape and its unit, if there is one.
    pub shape: Option<(f64, &'static str)>,
}

/// A formula for what remains.
#[derive(Clone, Debug, PartialEq)]
pub struct Proposal {
    /// As people read it: `0.41*sin(14*q)`.
    pub formula: String,
    /// Share of the mean square that it explains in trials that were left out, equation (2).
    pub share: f64,
    /// Least share of the halves of the trials in which one of its terms was selected.
    pub stability: f64,
    /// Its terms.
    pub terms: Vec<ProposedTerm>,
}

impl Proposal {
    /// The text of a `my_effect.toml`.
    ///
    /// - `id`: small letters, digits and _
    pub fn to_toml(&self, id: &str) -> String {
        let mut parameters = String::new();
        let mut parts = Vec::new();
        let source = format!("proposed from residuals, where {} of the mean square is explained", short(self.share));
        for (i, term) in self.terms.iter().enumerate() {
            let size = if self.terms.len() == 1 { "A".to_owned() } else { format!("A{}", i + 1) };
            let shape = if self.terms.len() == 1 { "k".to_owned() } else { format!("k{}", i + 1) };
            let c = term.coefficient;
            let reach = rounded(3.0 * c.abs());
            parameters.push_str(&format!(
                "\n[parameters.{size}]\nunit = \"{}\"\nrole = \"amplitude\"\nplausible = [-{reach:?}, \
                 {reach:?}]\ntypical = {:?}\n\
                 source = \"{source}: {}\"\n",
                term.unit,
                rounded(c.abs()),
                short(c)
            ));
            if let Some((k, unit)) = term.shape {
                let [low, high] = [rounded(0.7 * k), rounded(1.3 * k)];
                parameters.push_str(&format!(
                    "\n[parameters.{shape}]\nunit = \"{unit}\"\nrole = \"shape\"\nstart = {:?}\nplausible = [{low:?}, \
                     {high:?}]\n\
                     source = \"{source}\"\n",
                    rounded(k)
                ));
            }
            parts.push(format!("{size}*{}", term.term.replace("k*", &format!("{shape}*"))));
        }
        format!(
            "# Proposed: {}\n[effect]\nid = \"{id}\"\nname = \"{}\"\nstage = \"joint\"\nformula = \"{}\"\n{parameters}",
            self.formula,
            self.formula,
            parts.join(" + ")
        )
    }
}

/// A number of three digits.
fn rounded(value: f64) -> f64 {
    format!("{value:.2e}").parse().unwrap_or(value)
}

pub(super) fn short(value: f64) -> String {
    format!("{}", rounded(value))
}
