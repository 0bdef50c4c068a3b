//! Setup files of old, as OpenSim's tools take them: what has been moved or replaced since.
//!
//! Source: `updateFromXMLNode` of OpenSim's `AbstractTool`, `ForwardTool` and `InverseKinematicsTool`. What was only
//! renamed is read under both names.

use crate::osim::{Document, DocumentError, ElementId};

/// Format of files that do not say theirs (`XMLDocument::updateDocumentVersion`).
const UNSTATED: u32 = 10500;
/// From this format on the `controls_file` of a tool is one of a `ControlSetController`, and there are no corrective springs.
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

/// The setup with everything where present tools look for it. Lines stay what they are.
///
/// # Errors
/// None that a document which was read would give.
pub fn upgraded(document: Document) -> Result<Document, DocumentError> {
    let root = document.root();
    let has_root = document.tag(root) == "OpenSimDocument";
    let tool = match document.children(root).first() {
        Some(&child) if has_root => child,
        _ => root,
    };
    let stated = document.attribute(root, "Version").filter(|_| has_root);
    let version = stated.map_or(Some(UNSTATED), |text| text.trim().parse().ok());
    match (document.tag(tool), version) {
        ("IKTool", Some(..=LAST_WITH_TRIALS)) => without_trials(document, tool, has_root),
        ("AnalyzeTool" | "ForwardTool", Some(..HAS_CONTROLLERS)) => with_controllers(document, tool),
        _ => Ok(document),
    }
}

/// Properties of the first trial as those of the tool; the others are lost, as in OpenSim.
fn without_trials(document: Document, tool: ElementId, has_root: bool) -> Result<Document, DocumentError> {
    let trials = document.child(tool, "IKTrialSet");
    let objects = trials.and_then(|set| document.child(set, "objects"));
    let Some((trials, trial)) = trials.zip(objects.and_then(|objects| document.child(objects, "IKTrial"))) else {
        return Ok(document);
    };
    let (around, content) = (document.range(trials), document.content(trial));
    let text = |range| String::from_utf8_lossy(&document.bytes()[range]).into_owned();
    let properties = [
        line_ends(&text(around.start..content.start)),
        text(content.clone()),
        line_ends(&text(content.end..around.end)),
    ];
    let defaults = [("constraint_weight", "20.0"), ("accuracy", if has_root { "1e-4" } else { "1e-5" })];
    let absent = defaults.iter().filter(|(property, _)| document.child(tool, property).is_none());
    let added: String = absent.map(|(property, value)| format!("<{property}>{value}</{property}>")).collect();
    let document = document.with_replaced(trials, &properties.concat())?.with_appended(tool, &added)?;
    without(document, tool, "optimizer_algorithm")
}

/// A controller in place of a file of controls, and one in place of corrective springs.
fn with_controllers(mut document: Document, tool: ElementId) -> Result<Document, DocumentError> {
    let mut controllers = String::new();
    if let Some(file) = document.child(tool, "controls_file") {
        let name = document.text(file);
        if !name.is_empty() && name != "Unassigned" {
            let content = String::from_utf8_lossy(&document.bytes()[document.range(file)]).replace(['\r', '\n'], " ");
            controllers = format!("<ControlSetController name=\"controlsetcontroller\">{content}</ControlSetController>");
        }
        document = without(document, tool, "controls_file")?;
    }
    let is_forward = document.tag(tool) == "ForwardTool";
    if is_forward && CORRECTIVE_SPRINGS.iter().any(|spring| document.child(tool, spring).is_some()) {
        controllers += "<CorrectionController name=\"correctioncontroller\"><kp>16.0</kp><kv>8.0</kv></CorrectionController>";
        for spring in CORRECTIVE_SPRINGS {
            document = without(document, tool, spring)?;
        }
    }
    if controllers.is_empty() {
        return Ok(document);
    }
    let set = document.child(tool, "ControllerSet");
    match set.map(|set| (set, document.child(set, "objects"))) {
        Some((_, Some(objects))) => document.with_appended(objects, &controllers),
        Some((set, None)) => document.with_appended(set, &format!("<objects>{controllers}</objects>")),
        None => {
            let set = format!("<ControllerSet name=\"Controllers\"><objects>{controllers}</objects></ControllerSet>");
            document.with_appended(tool, &set)
        }
    }
}

/// The document without a property.
fn without(document: Document, tool: ElementId, property: &str) -> Result<Document, DocumentError> {
    let Some(element) = document.child(tool, property) else { return Ok(document) };
    let text = String::from_utf8_lossy(&document.bytes()[document.range(element)]).into_owned();
    document.with_replaced(element, &line_ends(&text))
}

fn line_ends(text: &str) -> String {
    text.chars().filter(|c| matches!(c, '\r' | '\n')).collect()
}
