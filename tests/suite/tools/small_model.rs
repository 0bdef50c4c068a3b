//! A small arm for tests: three hinges, a coupled and a locked coordinate, markers, two muscles.

use std::path::Path;

use carpus::storage::Storage;
use carpus::tools::{Outcome, ToolError, run_tool};

/// `MUSCLES`: what stands in the force set.
const MODEL: &str = r#"<?xml version="1.0" encoding="UTF-8" ?>
<OpenSimDocument Version="40500">
<Model name="small">
<BodySet name="bodyset"><objects>
<Body name="upper"><mass>2</mass><mass_center>0 -0.14 0</mass_center><inertia>0.015 0.002 0.015 0 0 0</inertia></Body>
<Body name="fore"><mass>1.2</mass><mass_center>0 -0.12 0</mass_center><inertia>0.008 0.001 0.008 0 0 0</inertia></Body>
<Body name="hand"><mass>0.5</mass><mass_center>0 -0.06 0</mass_center><inertia>0.001 0.0004 0.001 0 0 0</inertia></Body>
</objects></BodySet>
<JointSet name="jointset"><objects>
<PinJoint name="shoulder"><socket_parent_frame>/ground</socket_parent_frame><socket_child_frame>/bodyset/upper</socket_child_frame>
<coordinates><Coordinate name="arm"><range>-3 3</range></Coordinate></coordinates></PinJoint>
<PinJoint name="elbow"><socket_parent_frame>upper_elbow</socket_parent_frame><socket_child_frame>/bodyset/fore</socket_child_frame>
<coordinates><Coordinate name="bend"><range>-3 3</range></Coordinate></coordinates>
<frames><PhysicalOffsetFrame name="upper_elbow"><socket_parent>/bodyset/upper</socket_parent><translation>0 -0.3 0</translation><orientation>0 0 0</orientation></PhysicalOffsetFrame></frames></PinJoint>
<UniversalJoint name="wrist"><socket_parent_frame>fore_wrist</socket_parent_frame><socket_child_frame>/bodyset/hand</socket_child_frame>
<coordinates><Coordinate name="deviation"><default_value>0.1</default_value><range>-3 3</range><locked>true</locked></Coordinate><Coordinate name="flexion"><range>-3 3</range></Coordinate></coordinates>
<frames><PhysicalOffsetFrame name="fore_wrist"><socket_parent>/bodyset/fore</socket_parent><translation>0 -0.25 0</translation><orientation>0 0.2 0</orientation></PhysicalOffsetFrame></frames></UniversalJoint>
</objects></JointSet>
<ConstraintSet name="constraintset"><objects>
<CoordinateCouplerConstraint name="couple"><coupled_coordinates_function><LinearFunction><coefficients>0.5 0.1</coefficients></LinearFunction></coupled_coordinates_function>
<independent_coordinate_names>bend</independent_coordinate_names><dependent_coordinate_name>flexion</dependent_coordinate_name></CoordinateCouplerConstraint>
</objects></ConstraintSet>
<ForceSet name="forceset"><objects>
MUSCLES
</objects></ForceSet>
<MarkerSet name="markerset"><objects>
<Marker name="U1"><socket_parent_frame>/bodyset/upper</socket_parent_frame><location>0.03 -0.1 0.01</location></Marker>
<Marker name="U2"><socket_parent_frame>/bodyset/upper</socket_parent_frame><location>-0.02 -0.28 0.03</location></Marker>
<Marker name="F1"><socket_parent_frame>/bodyset/fore</socket_parent_frame><location>0.02 -0.1 0.02</location></Marker>
<Marker name="F2"><socket_parent_frame>/bodyset/fore</socket_parent_frame><location>-0.03 -0.22 0</location></Marker>
<Marker name="H1"><socket_parent_frame>/bodyset/hand</socket_parent_frame><location>0.02 -0.05 0.03</location></Marker>
<Marker name="H2"><socket_parent_frame>/bodyset/hand</socket_parent_frame><location>0 -0.11 -0.02</location></Marker>
</objects></MarkerSet>
</Model>
</OpenSimDocument>
"#;

/// A muscle of a class from the upper arm to the forearm.
///
/// - `properties`: further properties, as text
pub fn muscle(class: &str, name: &str, properties: &str) -> String {
    format!(
        "<{class} name=\"{name}\">{properties}<GeometryPath name=\"path\"><PathPointSet><objects>\
         <PathPoint name=\"p1\"><socket_parent_frame>/bodyset/upper</socket_parent_frame><location>0.02 -0.02 \
         0</location></PathPoint>\
         <PathPoint name=\"p2\"><socket_parent_frame>/bodyset/fore</socket_parent_frame><location>0.03 -0.05 \
         0</location></PathPoint>\
         </objects></PathPointSet></GeometryPath><max_isometric_force>500</max_isometric_force>\
         <optimal_fiber_length>0.12</optimal_fiber_length></{class}>"
    )
}

/// The model with these muscles.
pub fn model(muscles: &str) -> String {
    MODEL.replace("MUSCLES", muscles)
}

/// A setup of a tool with the model `small.osim` and results in the setup's folder.
pub fn setup(class: &str, inner: &str) -> String {
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\" ?>\n<OpenSimDocument Version=\"40500\">\n<{class} \
         name=\"run\">\n<model_file>small.osim</model_file>\n<results_directory>RESULTS</results_directory>\n{inner}\n\
         </{class}>\n</OpenSimDocument>\n"
    )
}

/// A motion of all free coordinates.
pub fn motion() -> String {
    super::opensim::motion_of(&["arm", "bend", "deviation", "flexion"], 21, 0.05, |t| {
        let bend = 0.7 + 0.3 * (2.0 * t).sin();
        vec![0.2 * t, bend, 0.1, 0.5 * bend + 0.1]
    })
}

/// A folder with files, in which a setup runs.
pub struct Folder(tempfile::TempDir);

impl Folder {
    /// With the model of these muscles, and the motion.
    pub fn new(muscles: &str) -> Folder {
        let folder = Folder(tempfile::tempdir().unwrap());
        folder.write("small.osim", &model(muscles));
        folder.write("motion.mot", &motion());
        folder
    }

    /// Where a file is.
    pub fn path(&self, name: &str) -> std::path::PathBuf {
        self.0.path().join(name)
    }

    /// Writes a file.
    pub fn write(&self, name: &str, text: &str) {
        std::fs::write(self.path(name), text).unwrap();
    }

    /// Runs a tool.
    pub fn run(&self, class: &str, inner: &str) -> Result<Outcome, ToolError> {
        self.write("setup.xml", &setup(class, inner).replace("RESULTS", "."));
        run_tool(&self.path("setup.xml"), None, false)
    }

    /// What is said of a tool that cannot run, with its hint, and without the folder.
    pub fn error(&self, class: &str, inner: &str) -> String {
        match self.run(class, inner) {
            Ok(_) => panic!("{inner} ran"),
            Err(error) => format!("{error} | {}", error.hint().unwrap_or_default())
                .replace(&format!("{}/", self.0.path().display()), ""),
        }
    }
}

/// The result whose name ends so.
pub fn table(outcome: &Outcome, end: &str) -> Storage {
    let file = outcome.files.iter().find(|f| f.path.to_string_lossy().ends_with(end));
    let file = file
        .unwrap_or_else(|| panic!("no {end} among {:?}", outcome.files.iter().map(|f| &f.path).collect::<Vec<_>>()));
    Storage::parse(&file.bytes, Path::new(end)).unwrap()
}

/// All warnings.
pub fn warnings(outcome: &Outcome) -> String {
    outcome.warnings.iter().map(|(_, _, text)| text.as_str()).collect::<Vec<_>>().join("\n")
}
