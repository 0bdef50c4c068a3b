//! What a formula may read.

/// Where an effect acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// A moment at the joint [N·m].
    Joint,
    /// The moment of muscles, multiplied by 1 + formula.
    Muscles,
}

/// A variable of a formula.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Variable {
    /// Of the joint, the trial, or, on muscles, of the muscle itself.
    Plain(Plain),
    /// Of a muscle that the formula names.
    OfMuscle(OfMuscle, String),
}

/// Variables without a muscle's name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Plain {
    /// Angle [rad].
    Angle,
    /// Speed [rad/s].
    Speed,
    /// Acceleration [rad/s²].
    Acceleration,
    /// Time in the trial [s].
    Time,
    /// Place in the session, 0 at its start to 1 at its end.
    Session,
    /// Moment of the muscles [N·m].
    Moment,
    /// Activation of the muscle itself.
    Activation,
    /// Moment arm of the muscle itself [m].
    Arm,
}

/// Variables of a muscle that the formula names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OfMuscle {
    /// Activation.
    Activation,
    /// Excitation.
    Excitation,
    /// Length from origin to insertion [m].
    Length,
    /// Lengthening speed [m/s].
    Speed,
    /// Moment arm [m].
    Arm,
}

const OF_JOINT: [(&str, Plain); 6] = [
    ("q", Plain::Angle),
    ("qdot", Plain::Speed),
    ("qddot", Plain::Acceleration),
    ("t", Plain::Time),
    ("t_session", Plain::Session),
    ("tau", Plain::Moment),
];
const OF_MUSCLES: [(&str, Plain); 5] = [
    ("q", Plain::Angle),
    ("t", Plain::Time),
    ("t_session", Plain::Session),
    ("a", Plain::Activation),
    ("r", Plain::Arm),
];
const NAMED: [(&str, OfMuscle); 5] = [
    ("a_", OfMuscle::Activation),
    ("e_", OfMuscle::Excitation),
    ("l_", OfMuscle::Length),
    ("v_", OfMuscle::Speed),
    ("r_", OfMuscle::Arm),
];

impl Place {
    fn plain(self) -> &'static [(&'static str, Plain)] {
        match self {
            Place::Joint => &OF_JOINT,
            Place::Muscles => &OF_MUSCLES,
        }
    }

    /// Variables without a muscle's name.
    pub fn words(self) -> Vec<&'static str> {
        self.plain().iter().map(|(word, _)| *word).collect()
    }

    /// Variables with one, for messages.
    pub fn words_of_muscles(self) -> &'static str {
        match self {
            Place::Joint => ", and of a muscle as FCR a_FCR, e_FCR, l_FCR, v_FCR, r_FCR",
            Place::Muscles => ": activation a and moment arm r are those of the muscle itself",
        }
    }
}

impl Variable {
    /// As a formula has it.
    pub fn word(&self) -> String {
        match self {
            Variable::Plain(plain) => {
                let mut all = OF_JOINT.iter().chain(&OF_MUSCLES);
                all.find(|(_, p)| p == plain).map_or_else(String::new, |(word, _)| (*word).to_owned())
            }
            Variable::OfMuscle(quantity, muscle) => {
                let prefix = NAMED.iter().find(|(_, q)| q == quantity).map_or("", |(prefix, _)| prefix);
                format!("{prefix}{muscle}")
            }
        }
    }

    /// The muscle that it names.
    pub fn muscle(&self) -> Option<&str> {
        match self {
            Variable::Plain(_) => None,
            Variable::OfMuscle(_, muscle) => Some(muscle),
        }
    }

    /// Values that recordings have, ends and 0 among them.
    pub fn usual_values(&self) -> &'static [f64] {
        match self {
            Variable::Plain(Plain::Angle) => &[-1.2, -0.6, -0.1, 0.0, 0.1, 0.6, 1.2],
            Variable::Plain(Plain::Speed) => &[-6.0, -1.0, -0.05, 0.0, 0.05, 1.0, 6.0],
            Variable::Plain(Plain::Acceleration) => &[-60.0, -5.0, 0.0, 5.0, 60.0],
            Variable::Plain(Plain::Time) => &[0.0, 0.5, 1.0, 5.0, 30.0],
            Variable::Plain(Plain::Session) => &[0.0, 0.5, 1.0],
            Variable::Plain(Plain::Moment) => &[-10.0, -1.0, 0.0, 1.0, 10.0],
            Variable::Plain(Plain::Activation) | Variable::OfMuscle(OfMuscle::Activation | OfMuscle::Excitation, _) => {
                &[0.0, 0.01, 0.25, 0.5, 1.0]
            }
            Variable::Plain(Plain::Arm) | Variable::OfMuscle(OfMuscle::Arm, _) => &[-0.02, -0.005, 0.005, 0.02],
            Variable::OfMuscle(OfMuscle::Length, _) => &[0.1, 0.25, 0.4],
            Variable::OfMuscle(OfMuscle::Speed, _) => &[-0.2, -0.01, 0.0, 0.01, 0.2],
        }
    }

    /// About how far it reaches from its middle in a recording.
    pub fn reach(&self) -> f64 {
        match self {
            Variable::Plain(Plain::Speed | Plain::Time) => 3.0,
            Variable::Plain(Plain::Acceleration | Plain::Moment) => 10.0,
            _ => 1.0,
        }
    }
}

/// Variables that a formula names, each once, parameters left out.
pub fn named_in(formula: &str, parameters: &[&str], place: Place) -> Vec<Variable> {
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let mut found: Vec<Variable> = Vec::new();
    let mut note = |word: &str| {
        if parameters.contains(&word) {
            return;
        }
        let plain = place.plain().iter().find(|(known, _)| *known == word).map(|(_, p)| Variable::Plain(*p));
        let of = |(prefix, quantity): &(&str, OfMuscle)| {
            let muscle = word.strip_prefix(prefix).filter(|m| !m.is_empty() && place == Place::Joint)?;
            Some(Variable::OfMuscle(*quantity, muscle.to_owned()))
        };
        let variable = plain.or_else(|| NAMED.iter().find_map(of));
        found.extend(variable.filter(|v| !found.contains(v)));
    };
    formula.split(|c| !is_word(c)).for_each(&mut note);
    found
}
