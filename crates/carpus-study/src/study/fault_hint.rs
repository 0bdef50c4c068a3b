//! What to do about a fault.

use super::fault::Fault;
use super::fault_words::{seven_digits, time_unit};
use carpus_numerics::plausible::{Measured, moment_unit_of_ratio};
use carpus_numerics::signals::{Finding, SignalError};

impl Fault {
    /// What to do about it, if there is something more to say than the message says.
    pub fn hint(&self) -> Option<String> {
        use Fault::*;
        let text = match self {
            MissingFile { named_at: Some(at), .. } => {
                format!("it is named at {at}; paths are relative to the folder of study.toml")
            }
            UnknownKey { nearest: Some(n), .. } => format!("did you mean `{n}`?"),
            NotInModel { nearest: Some(n), .. } => format!("did you mean `{n}`?"),
            UnknownSection { nearest: Some(n), .. } => format!("did you mean [{n}]?"),
            UnknownWord { nearest: Some(n), .. } => format!("did you mean `{n}`?"),
            MissingColumn { nearest: Some(n), .. } => {
                format!("did you mean `{n}`? Column names are set in [columns] of study.toml")
            }
            UnknownColumn { in_trial: true, nearest, .. } => format!(
                "{}a column that is not needed goes into [columns] ignore = [\"…\"] of study.toml",
                nearest.as_ref().map(|n| format!("did you mean `{n}`? Else: ")).unwrap_or_default()
            ),
            UnknownColumn { nearest: Some(n), .. } => format!("did you mean `{n}`?"),
            RawEmg { error: SignalError::Cutoff { .. }, .. } => {
                "set [emg] band_pass_hz to a band below half the sample rate; an envelope recorded at a low rate is \
                 not raw EMG"
                    .to_owned()
            }
            RawEmg { error: SignalError::NoMvc { .. }, .. } => {
                "the channel is silent in every MVC trial: check electrode and column".to_owned()
            }
            EmgChannel { finding: Finding::AboveMvc { .. }, .. } => {
                "excitation is held at 1 there; record MVC trials that reach the maximum of every muscle".to_owned()
            }
            EmgChannel { finding: Finding::Artefact { .. }, .. } => {
                "put the mean of its neighbours there, or leave the trial out; in an MVC trial it sets the level by \
                 which the channel is divided in all trials"
                    .to_owned()
            }
            EmgChannel { finding: Finding::MainsHum { .. }, .. } => {
                "raise the lower edge of [emg] band_pass_hz above the mains frequency, or record again".to_owned()
            }
            UnequalSteps { .. } => "resample the recording at equal steps".to_owned(),
            Recording(error) => return error.hint(),
            NotAStudy { hint, .. } => (*hint).to_owned(),
            Refused { hint, .. } => hint.clone(),
            TomlSyntax { message } if message.contains("escape") => {
                "between double quotes a backslash is written twice; between folders write /".to_owned()
            }
            NotText => "save the file as UTF-8".to_owned(),
            NotATable { .. } => "give the table's path here; models are named by `model` in study.toml".to_owned(),
            Separator { .. } => "export with commas between columns and points as decimal marks".to_owned(),
            BadNumber { found, .. } if found.contains(['−', '–']) => "use a hyphen, -, as minus sign".to_owned(),
            BadNumber { found, .. } if found.contains(',') => "use a point as decimal mark".to_owned(),
            BadNumber { found, .. } if found.is_empty() || found.eq_ignore_ascii_case("nan") => {
                "cut the samples off or fill them in; carpus does not guess missing samples".to_owned()
            }
            TimeNotIncreasing { .. } => "sort the rows by time, or split the file into two trials".to_owned(),
            TimeRepeated { .. } => "delete one of the two rows, or give time more decimals".to_owned(),
            ImplausibleTime { median_step_s, .. } => match time_unit(*median_step_s) {
                Some(unit) => format!("are these {unit}? carpus reads seconds"),
                None => "time is read in seconds; cut a long recording into trials".to_owned(),
            },
            TooManySamples { .. } => "cut it into trials, or average it to fewer samples per second".to_owned(),
            Gap { .. } => "split the trial there, fill the samples in, or set [checks] max_gap_s".to_owned(),
            EmgOutOfRange { above: true, clamped: false, .. } => {
                "is it in percent or mV, or was the MVC too small? Divide by the highest envelope of the session"
                    .to_owned()
            }
            EmgOutOfRange { above: false, clamped: false, .. } => {
                "an envelope is never negative: was the signal rectified?".to_owned()
            }
            AngleOutOfRange { .. } => {
                "check the zero and the sign of the angle, or widen the coordinate's range in the model".to_owned()
            }
            LooksLikeRadians { .. } => "multiply by 180/π, or set [columns] angle_unit = \"rad\"".to_owned(),
            LooksLikeDegrees { .. } => "set [columns] angle_unit = \"deg\"".to_owned(),
            VelocityDisagrees { ratio, .. } if *ratio < 0.0 => "its sign is turned".to_owned(),
            VelocityDisagrees { ratio, .. } if (0.008..0.035).contains(ratio) => "is it in rad/s?".to_owned(),
            VelocityDisagrees { .. } => "leave the column out and the derivative is used".to_owned(),
            MomentSign { .. } => {
                "the moment is the one the person exerts, positive in the coordinate's positive direction".to_owned()
            }
            MomentScale { .. } => "is it in N·m?".to_owned(),
            SomeStartTimes { .. } => {
                "state `start_time_s` in every row of the participant, or leave the column out".to_owned()
            }
            OwnGravityNotTurned => {
                "leave \"gravity\" out of include: the effect `gravity` of carpus diagnose is turned with the \
                 arm"
                .to_owned()
            }
            ColumnResampled { quantity: "angle", .. } => {
                "its speed jumps from one to the next: give the angle at its own rate, or the velocity as a \
                 column"
                    .to_owned()
            }
            ColumnResampled { quantity: "raw EMG", .. } => {
                "what the muscle did between them is lost, and filters of EMG see steps: give the channel at the rate \
                 of its recorder"
                    .to_owned()
            }
            ColumnResampled { .. } => {
                "rows between them say nothing of its noise; for an envelope that is slower than they are nothing is \
                 lost"
                    .to_owned()
            }
            MomentResampled { .. } => {
                "its noise is estimated from its own samples alone; nothing else needs to be done".to_owned()
            }
            PostureMismatch { .. } => "check the zero and the sign of the angle".to_owned(),
            Implausible { doubt, .. } => doubt.hint(),
            ImplausibleBuild { mass_kg, height_m, doubt } => match doubt.slip() {
                Some(slip) => {
                    let kg = mass_kg * slip.factor;
                    format!("check the unit: is the mass in {}? {mass_kg} {0} are {kg:.1} kg", slip.unit)
                }
                None => format!("check mass ({mass_kg} kg) and height ({height_m} m)"),
            },
            UnitInName { unit, taken_as, factor: Some(factor), .. } => {
                let scaled = format!(
                    "1 {} is {} {taken_as}: multiply the column, and give it a name without the \
                                      unit",
                    unit.symbol,
                    seven_digits(*factor)
                );
                match (unit.symbol, *taken_as) {
                    ("rad", "deg") => format!("{scaled}; or set [columns] angle_unit = \"rad\""),
                    ("deg", "rad") => format!("{scaled}; or set [columns] angle_unit = \"deg\""),
                    _ => scaled,
                }
            }
            UnitInName { unit, holds, .. } => match (unit.of, holds) {
                (Measured::Voltage, Measured::Part) => {
                    "raw EMG is declared by [emg] kind = \"raw\"; envelopes are divided by the maximum voluntary \
                     contraction"
                        .to_owned()
                }
                (Measured::Voltage, _) => "is it the recorder's voltage? multiply it by the calibration factor \
                                           first"
                    .to_owned(),
                (Measured::MomentPerMass, _) => "multiply it by the body mass first".to_owned(),
                (Measured::Force, Measured::Moment) => "is it a force? multiply it by its lever arm in metres \
                                                        first"
                    .to_owned(),
                _ => "is it the right column? see [columns] in study.toml".to_owned(),
            },
            MvcDisagrees { stated_n_m, measured_n_m, .. } => {
                let otherwise = "the trial was not maximal, or the MVC is of another session or posture";
                // The one or the other is not in N·m; which of the two, only the lab knows.
                match (moment_unit_of_ratio(measured_n_m / stated_n_m), moment_unit_of_ratio(stated_n_m / measured_n_m))
                {
                    (Some(unit), _) => {
                        format!(
                            "1 {0} is {1:.3} N·m: is the moment of the trials in {0}? Else: \
                                 {otherwise}",
                            unit.symbol, unit.factor
                        )
                    }
                    (_, Some(unit)) => {
                        format!("1 {0} is {1:.3} N·m: is the MVC in {0}? Else: {otherwise}", unit.symbol, unit.factor)
                    }
                    _ => format!("EMG and strength are scaled by them: {otherwise}"),
                }
            }
            MomentReversed { column, .. } => format!(
                "multiply `{column}` by -1: it is the moment that the person exerts, not the machine's; or exchange \
                 flexion and extension in trials.csv"
            ),
            ChannelsExchanged { .. } => {
                "check electrodes and cables, or exchange the two in [columns] emg of study.toml".to_owned()
            }
            MissingEmgFile => "name it in the column emg_file of trials.csv, or all of them by [emg_recorder] file = \
                               \"{trial}_emg.csv\""
                .to_owned(),
            OtherTimes { .. } => "channels of one rate can be read together: name those in [columns] emg".to_owned(),
            EmgClock { .. } => {
                "raise max_delay_s in [emg_recorder], or check that shared and shared_with are the same \
                                quantity and sign; a known delay is delay_s"
                    .to_owned()
            }
            EmgClockDoubtful { .. } => {
                "are shared and shared_with of [emg_recorder] the same quantity? a known delay is delay_s".to_owned()
            }
            LittleInCommon { .. } => {
                "check delay_s in [emg_recorder], and that the two files are of one trial".to_owned()
            }
            DeceptiveCharacter { .. } => {
                "control characters, line breaks, direction marks and byte order marks do not belong in names; write \
                 the name anew"
                    .to_owned()
            }
            OutsideStudy { .. } => "it is read; a study that is copied elsewhere lacks it".to_owned(),
            NotRegular { .. } => "tables and trials are read from files, not from devices or pipes".to_owned(),
            _ => return None,
        };
        Some(text)
    }
}
