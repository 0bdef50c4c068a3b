//! The formats of recordings.

/// A format of recordings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Text: CSV and whatever else has lines of numbers below a line of names.
    Text,
    /// Workbooks of Excel since 2007, `.xlsx`.
    Workbook,
    /// MATLAB's `.mat` of level 5: what `save -v6` and `save -v7` write.
    Matlab,
    /// European Data Format, `.edf`, and its variant of 24 bits, `.bdf`.
    Edf,
    /// Motion capture, `.c3d`: its analog channels.
    C3d,
}

impl Format {
    /// Ends of names of files that may be recordings other than text.
    pub const ENDS: [&'static str; 5] = ["xlsx", "mat", "edf", "bdf", "c3d"];

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Format::Text => "text",
            Format::Workbook => "workbook",
            Format::Matlab => "MATLAB file",
            Format::Edf => "EDF file",
            Format::C3d => "C3D file",
        }
    }

    /// What a table is of, in a file of this format.
    pub fn table_word(self) -> &'static str {
        match self {
            Format::Text => "block",
            Format::Workbook => "sheet",
            Format::Matlab => "variable",
            Format::Edf => "sampling rate",
            Format::C3d => "part",
        }
    }

    /// What is read of it.
    pub(super) fn expected(self) -> &'static str {
        match self {
            Format::Text => "a line of names with rows of numbers below is read",
            Format::Workbook => "a row of names with rows of numbers below is read, on any sheet",
            Format::Matlab => {
                "vectors of one length are read, of a struct or beside each other: time, torque, angle, EMG; of a \
                 table() or timetable() save table2struct(T, \"ToScalar\", true)"
            }
            Format::Edf => "signals of at least 10 samples are read",
            Format::C3d => "analog channels are read",
        }
    }
}
