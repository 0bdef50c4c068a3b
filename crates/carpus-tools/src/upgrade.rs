//! Setup files of old, as OpenSim's tools take them: what has been moved or replaced since.
//!
//! Source: `updateFromXMLNode` of OpenSim's `AbstractTool`, `ForwardTool` and `InverseKinematicsTool`. What was only
//! renamed is read under both names.

use std::ops::Range;

use carpus_osim::osim::{Document, DocumentError, ElementId};

/// Format of files that do not say theirs (`XMLDocument::updateDocumentVersion`).
const UNSTATED: u32 = 10500;
/// From this format on the `controls_file` of a tool is one of a `ControlSetController`, and there are no corrective
/// springs.
const HAS_CONTROLLERS: u32 = 10904;
/// Up to this format the properties of inverse kinematics stand in an `IKTrial`.
const LAST_WITH_TRIALS: u32 = 20201;
/// Springs that held the body where a motion had it.
const CORRECTIVE_SPRINGS: [&str; 4] = [
    "body1_linear_corrective_spring_active",
    "body1_torsional_corrective_spring_active",
    "body2_linear_corrective_spring_active",
    "body2_torsional_corrective_spring_active",
];
/// What stands in their place.
const CORRECTION: &str =
    "<CorrectionController name=\"correctioncontroller\"><kp>16.0</kp><kv>8.0</kv></CorrectionController>";

type Edits = Vec<(Range<usize>, String)>;

/// The setup with everything where present tools look for it. Lines stay what they are.
///
/// # Errors
/// None that a document which was read would give.
pub fn upgraded(document: Document) -> Result<Document, DocumentError> {
    let (root, tool) = (document.root(), document.object());
    let has_root = document.tag(root) == "OpenSimDocument";
    let stated = document.attribute(root, "Version").filter(|_| has_root);
    let version = stated.map_or(Some(UNSTATED), |text| text.trim().parse().ok());
    let edits = match (document.tag(tool), version) {
        ("IKTool", Some(..=LAST_WITH_TRIALS)) => trial_opened(&document, tool, has_root),
        ("AnalyzeTool" | "ForwardTool", Some(..HAS_CONTROLLERS)) => with_controllers(&document, tool),
        _ => Vec::new(),
    };
    if edits.is_empty() { Ok(document) } else { document.spliced(edits) }
}

/// Properties of the first trial become those of the tool, which OpenSim runs alone; the other trials stay beside them,
/// unread.
fn trial_opened(document: &Document, tool: ElementId, has_root: bool) -> Edits {
    let trials = document.child(tool, "IKTrialSet");
    let Some((trials, objects)) = trials.and_then(|set| Some((set, document.child(set, "objects")?))) else {
        return Vec::new();
    };
    let Some(trial) = document.child(objects, "IKTrial") else { return Vec::new() };
    let (around, content) = (document.range(trials), document.inner(trial));
    // OpenSim adds a constraint_weight of 20 as well, which has no effect.
    let accuracy = if has_root { "1e-4" } else { "1e-5" };
    let added = match document.child(tool, "accuracy") {
        Some(_) => String::new(),
        None => format!("<accuracy>{accuracy}</accuracy>"),
    };
    let mut edits = vec![
        removed(document, around.start..content.start),
        removed(document, content.end..document.range(trial).end),
        removed(document, document.inner(objects).end..around.end),
        document.appended(tool, &added),
    ];
    let algorithm = document.child(tool, "optimizer_algorithm");
    edits.extend(algorithm.map(|element| removed(document, document.range(element))));
    edits
}

/// A controller in place of a file of controls, and one in place of corrective springs.
fn with_controllers(document: &Document, tool: ElementId) -> Edits {
    let (mut edits, mut controllers) = (Vec::new(), String::new());
    if let Some(file) = document.child(tool, "controls_file") {
        let (name, range) = (document.text(file), document.range(file));
        if !name.is_empty() && name != "Unassigned" {
            let property = String::from_utf8_lossy(&document.bytes()[range.clone()]).replace(['\r', '\n'], " ");
            let start = "<ControlSetController name=\"controlsetcontroller\">";
            controllers = format!("{start}{property}</ControlSetController>");
        }
        edits.push(removed(document, range));
    }
    let is_spring = |child: &&ElementId| CORRECTIVE_SPRINGS.contains(&document.tag(**child));
    let springs: Vec<&ElementId> = document.children(tool).iter().filter(is_spring).collect();
    if document.tag(tool) == "ForwardTool" && !springs.is_empty() {
        controllers.push_str(CORRECTION);
        edits.extend(springs.into_iter().map(|spring| removed(document, document.range(*spring))));
    }
    if controllers.is_empty() {
        return edits;
    }
    let set = document.child(tool, "ControllerSet");
    edits.push(match set.map(|set| (set, document.child(set, "objects"))) {
        Some((_, Some(objects))) => document.appended(objects, &controllers),
        Some((set, None)) => document.appended(set, &format!("<objects>{controllers}</objects>")),
        None => {
            let set = format!("<ControllerSet name=\"Controllers\"><objects>{controllers}</objects></ControllerSet>");
            document.appended(tool, &set)
        }
    });
    edits
}

/// The splice that takes text away, all but its line ends.
fn removed(document: &Document, range: Range<usize>) -> (Range<usize>, String) {
    let line_ends = document.bytes()[range.clone()].iter().filter(|b| matches!(b, b'\r' | b'\n'));
    let line_ends = line_ends.map(|b| char::from(*b)).collect();
    (range, line_ends)
}
