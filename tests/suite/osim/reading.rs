//! Reading: document tolerance, upgrades of old formats, errors.

use carpus::osim::spec::{FrameKind, MotionType, MuscleKind, Quadrant};
use carpus::osim::{Document, DocumentErrorKind, OsimError, OsimFile, ProblemKind, Severity};
use proptest::prelude::*;

use super::small_models::{FORMAT_40000, format_30000};

fn read(text: &str) -> Result<OsimFile, OsimError> {
    OsimFile::parse(text.as_bytes(), "small.osim")
}

/// The small model with one piece of text replaced.
fn with(from: &str, to: &str) -> Result<OsimFile, OsimError> {
    assert!(FORMAT_40000.contains(from), "{from}");
    read(&FORMAT_40000.replacen(from, to, 1))
}

/// The only problem of a model, and its line.
fn problem(result: Result<OsimFile, OsimError>) -> (usize, ProblemKind) {
    match result {
        Err(OsimError::Invalid { problems }) => {
            assert_eq!(problems.len(), 1, "{problems:?}");
            (problems[0].line, problems[0].kind.clone())
        }
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("no error"),
    }
}

fn line_of(text: &str) -> usize {
    FORMAT_40000[..FORMAT_40000.find(text).expect("text in model")].lines().count()
}

#[test]
fn verif_small_model_of_format_4() {
    let file = read(FORMAT_40000).expect("valid");
    let spec = &file.spec;
    assert_eq!(spec.name, "small");
    assert_eq!(spec.coordinates[0].motion_type, MotionType::Rotational);
    assert_eq!(spec.frames[spec.joints[0].parent_frame.0].at.path, "/jointset/elbow/ground_offset");
    assert_eq!(spec.wrap_objects[0].quadrant, Quadrant::Half { axis: 1, sign: -1 });
    let muscle = &spec.muscles[0];
    let MuscleKind::Millard2012Equilibrium(millard) = &muscle.kind else { panic!("class") };
    assert_eq!(millard.fiber_force_length.strain_at_one_norm_force, 0.6);
    assert_eq!(millard.fiber_force_length.curviness, None, "empty optional property");
    assert_eq!(millard.active_force_length.transition_norm_fiber_length, 0.73, "absent curve");
    assert_eq!(muscle.min_control, 0.01);
    assert_eq!(file.document.text(carpus::osim::ElementId(2)), "A & B");
    assert!(!file.diagnostics.has_unsupported(), "{:?}", file.diagnostics.items);
}

#[test]
fn verif_entities_are_characters_in_text_and_attributes() {
    let written = "&lt;&gt;&amp;&quot;&apos;&#65;&#x42;&#X43;";
    let text = format!("<a name=\"{written}\">{written}</a>");
    let document = Document::parse(text.into_bytes(), "entities.xml").unwrap();
    assert_eq!(document.text(document.root()), "<>&\"'ABC");
    assert_eq!(document.attribute(document.root(), "name").as_deref(), Some("<>&\"'ABC"));
}

/// What looks like the start of an entity is text; text of a megabyte is read in one pass.
#[test]
fn verif_ampersands_are_text_in_any_number() {
    let many = "&".repeat(1_000_000);
    let text = format!("<a name=\"{many};\">{many}&amp;&#x0010FFFF;&#65;{many}</a>");
    let document = Document::parse(text.into_bytes(), "many.xml").unwrap();
    let root = document.root();
    assert_eq!(document.text(root), format!("{many}&\u{10FFFF}A{many}"));
    assert_eq!(document.attribute(root, "name"), Some(format!("{many};")));
}

#[test]
fn verif_coordinates_that_no_axis_uses_are_kept_where_opensim_keeps_them() {
    let last = "</Coordinate>\n\t\t\t\t\t</coordinates>";
    let file = with(last, "</Coordinate><Coordinate name=\"idle\"/></coordinates>").expect("it comes last");
    let names: Vec<&str> = file.spec.coordinates.iter().map(|c| c.name.as_str()).collect();
    assert_eq!(names, ["elbow_flexion", "idle"]);
    assert_eq!(file.spec.coordinates[1].motion_type, MotionType::Coupled);
    let warned = file.diagnostics.items.iter().any(|d| d.message.contains("\"idle\" is not used by any axis"));
    assert!(warned, "{:?}", file.diagnostics.items);
    let first = "<Coordinate name=\"elbow_flexion\">";
    let (_, kind) = problem(with(first, &format!("<Coordinate name=\"idle\"/>{first}")));
    assert!(matches!(kind, ProblemKind::UnusedCoordinate { .. }), "{kind:?}");
}

#[test]
fn verif_white_space_leaves_the_name_of_an_old_model() {
    assert!(format_30000().contains("<Model name=\"small old\">"));
    assert_eq!(read(&format_30000()).expect("valid").spec.name, "smallold");
    let new = with("Model name=\"small\"", "Model name=\"small new\"").expect("valid");
    assert_eq!(new.spec.name, "small new");
}

#[test]
fn verif_old_format_is_upgraded_as_in_opensim() {
    let file = read(&format_30000()).expect("valid");
    let spec = &file.spec;
    assert_eq!(
        (spec.name.as_str(), spec.bodies[0].name.as_str()),
        ("smallold", "forearm"),
        "white space is removed from names"
    );
    assert_eq!(spec.bodies[0].inertia[(0, 0)], 0.00123457, "six significant digits");
    let FrameKind::Offset { orientation, parent, .. } = spec.frames[spec.joints[0].parent_frame.0].kind else {
        panic!("the joint has an offset frame of its own")
    };
    assert_eq!((orientation.x, parent.0), (0.123457, 0));
    let muscle = &spec.muscles[0];
    assert!(!muscle.applies_force, "isDisabled");
    assert_eq!(muscle.min_control, 0.01, "a trivial min_control gives way to the class' default");
    assert_eq!(muscle.path.points[1].name, "P1_0");
    assert_eq!(spec.frames[muscle.path.points[1].frame.0].name, "forearm");
    assert_eq!(file.diagnostics.of(Severity::Unsupported).count(), 0, "the muscle's class is computed");
}

#[test]
fn verif_defaults_section_sets_absent_properties() {
    let defaults = "<Model name=\"small\">\n<defaults><Millard2012EquilibriumMuscle name=\"default\">\
        <fiber_damping>0.05</fiber_damping><max_isometric_force>7</max_isometric_force>\
        <TendonForceLengthCurve><strain_at_one_norm_force>0.033</strain_at_one_norm_force></TendonForceLengthCurve>\
        <FiberForceLengthCurve><strain_at_zero_force>0.5</strain_at_zero_force></FiberForceLengthCurve>\
        </Millard2012EquilibriumMuscle></defaults>";
    let file = with("<Model name=\"small\">", defaults).expect("valid");
    let MuscleKind::Millard2012Equilibrium(millard) = &file.spec.muscles[0].kind else { panic!("class") };
    assert_eq!(millard.fiber_damping, 0.05);
    assert_eq!(file.spec.muscles[0].max_isometric_force, 250.0, "the muscle's own value wins");
    assert_eq!(millard.tendon_force_length.strain_at_one_norm_force, 0.033, "absent curve");
    assert_eq!(millard.fiber_force_length.strain_at_zero_force, 0.0, "a curve of its own takes nothing over");
}

#[test]
fn verif_tolerated_markup_is_kept() {
    let strange = b"\xEF\xBB\xBF<?xml version='1.1' encoding='UTF-8'?>\r\n<!-- a <!-- b -->\r\n<OpenSimDocument \
                    Version=\"40000\">\
        <Model name=\"caf\xE9 \x96\"><credits>A & B &amp; C &unknown;</credits>\
        <Foo::Bar>1</Foo::Bar><BodySet/></Model>\r\n</OpenSimDocument>\r\n<!-- end -->";
    let document = Document::parse(strange.to_vec(), "strange.osim").expect("tolerated");
    assert_eq!(document.bytes(), strange);
    let model = document.children(document.root())[0];
    let tags: Vec<&str> = document.children(model).iter().map(|&child| document.tag(child)).collect();
    assert_eq!(tags, ["credits", "Foo::Bar", "BodySet"]);
    assert_eq!(document.text(document.children(model)[0]), "A & B & C &unknown;");
    assert_eq!(document.line(model), 3);
    assert!(OsimFile::parse(strange.to_vec(), "strange.osim").is_ok());
}

#[test]
fn verif_broken_documents_are_refused_with_their_line() {
    let kind = |text: &str| Document::parse(text.as_bytes().to_vec(), "x.osim").expect_err("broken");
    let truncated = kind(&FORMAT_40000[..FORMAT_40000.find("<radius>").expect("radius")]);
    assert_eq!(truncated.line, line_of("<radius>"));
    assert!(matches!(truncated.kind, DocumentErrorKind::NotClosed { ref tag, opened_line }
        if tag == "WrapCylinder" && opened_line == line_of("<WrapCylinder")));
    let nested = kind("<a>\n<b>\n<c>\n</b></c></a>");
    assert_eq!(nested.line, 4);
    assert!(matches!(nested.kind, DocumentErrorKind::MismatchedEnd { ref expected, ref found, opened_line: 3 }
        if expected == "c" && found == "b"));
    assert!(matches!(kind("<a/>\n<b/>").kind, DocumentErrorKind::SecondRoot { .. }));
    assert!(matches!(kind("<a></a></b>").kind, DocumentErrorKind::UnexpectedEnd { .. }));
    assert!(matches!(kind("").kind, DocumentErrorKind::NoElement));
    assert!(matches!(kind("  \n<?xml version=\"1.0\"?>").kind, DocumentErrorKind::NoElement));
    assert!(matches!(kind("hello").kind, DocumentErrorKind::TextOutsideRoot));
    assert!(matches!(kind("<a><b attr=\"x></b></a>").kind, DocumentErrorKind::Markup { .. }));
    assert!(matches!(kind(&"<a>".repeat(5000)).kind, DocumentErrorKind::TooDeep { .. }));
}

#[test]
fn verif_other_files_are_refused() {
    assert!(matches!(read("<ScaleTool/>"), Err(OsimError::NotAModel { line: 1, .. })));
    assert!(matches!(
        read("<OpenSimDocument Version=\"40000\">\n<ScaleTool/></OpenSimDocument>"),
        Err(OsimError::NotAModel { line: 2, .. })
    ));
    for version in ["10500", "40700", "", "new"] {
        let text = format!("<OpenSimDocument Version=\"{version}\"><Model/></OpenSimDocument>");
        let Err(OsimError::UnsupportedVersion { found, .. }) = read(&text) else { panic!("{version}") };
        assert_eq!(found, version);
    }
    assert!(matches!(OsimFile::read("/no/such/file.osim"), Err(OsimError::Read { .. })));
}

#[test]
fn verif_frames_that_are_not_supported_are_called_so_where_they_are_used() {
    const FRAME: &str = "<OddFrame name=\"tilted\"><socket_point_a>/a</socket_point_a></OddFrame>";
    let opening = "<BodySet name=\"bodyset\">";
    assert!(FORMAT_40000.contains(opening));
    let text = FORMAT_40000.replacen(opening, &format!("<components>{FRAME}</components>{opening}"), 1);
    // Unused, it is no error.
    let file = read(&text).unwrap();
    let item = file.diagnostics.of(Severity::Unsupported).next().unwrap();
    assert_eq!((item.line, item.path.as_str()), (line_of(opening), "/tilted"));
    for used in ["/tilted", "/tilted/offset"] {
        let text = text.replacen("<socket_child_frame>/bodyset/forearm<", &format!("<socket_child_frame>{used}<"), 1);
        let Err(OsimError::Invalid { problems }) = read(&text) else { panic!("no error") };
        let problem = &problems[0];
        assert_eq!(problem.line, line_of("<socket_child_frame>"));
        assert!(problem.hint().unwrap().contains("PhysicalOffsetFrame"));
        let ProblemKind::UnsupportedFrame { name, class, line, .. } = &problem.kind else { panic!("{problem}") };
        assert_eq!((name.as_str(), class.as_str(), *line), (used, "OddFrame", line_of(opening)));
    }
}

#[test]
fn verif_unknown_references_are_named_with_a_suggestion() {
    let (line, kind) = problem(with("<socket_child_frame>/bodyset/forearm<", "<socket_child_frame>/bodyset/forarm<"));
    assert_eq!(line, line_of("<socket_child_frame>"));
    let ProblemKind::UnknownReference { name, nearest, .. } = kind else { panic!("{kind:?}") };
    assert_eq!((name.as_str(), nearest.as_deref()), ("/bodyset/forarm", Some("/bodyset/forearm")));
    let (_, kind) = problem(with("<coordinate>elbow_flexion<", "<coordinate>elbow_flexon<"));
    assert!(matches!(kind, ProblemKind::UnknownReference { what: "coordinate", nearest: Some(ref nearest), .. }
        if nearest == "elbow_flexion"));
    let (line, kind) = problem(with("<wrap_object>epicondyle<", "<wrap_object>olecranon<"));
    assert_eq!(line, line_of("<wrap_object>"));
    assert!(matches!(kind, ProblemKind::UnknownReference { what: "wrap object", nearest: None, .. }));
    let result = with("<socket_parent>/ground<", "<socket_parent>/jointset/elbow/ground_offset<");
    assert!(matches!(problem(result).1, ProblemKind::FrameLoop));
}

#[test]
fn verif_impossible_values_are_refused() {
    let out_of_range = |result| matches!(problem(result).1, ProblemKind::OutOfRange { .. });
    assert!(out_of_range(with("<optimal_fiber_length>0.16<", "<optimal_fiber_length>-0.16<")));
    assert!(out_of_range(with("<optimal_fiber_length>0.16<", "<optimal_fiber_length>0<")));
    assert!(out_of_range(with("<max_isometric_force>250<", "<max_isometric_force>-1<")));
    assert!(out_of_range(with("<tendon_slack_length>0.13<", "<tendon_slack_length>Inf<")));
    assert!(out_of_range(with("<radius>0.01<", "<radius>0<")));
    let not_readable = |result| matches!(problem(result).1, ProblemKind::NotReadable { .. });
    assert!(not_readable(with("<optimal_fiber_length>0.16<", "<optimal_fiber_length>NaN<")));
    assert!(not_readable(with("<optimal_fiber_length>0.16<", "<optimal_fiber_length>16 cm<")));
    assert!(not_readable(with("<mass_center>0.12 0 0<", "<mass_center>0.12 0<")));
    assert!(not_readable(with("<clamped>true<", "<clamped>yes<")));
    assert!(not_readable(with("<quadrant>-y<", "<quadrant>below<")));
    assert!(not_readable(with("<coefficients>1 0<", "<coefficients>1,0<")));
}

#[test]
fn verif_incomplete_components_are_refused() {
    let start = FORMAT_40000.find("\t\t\t\t\t<GeometryPath").expect("path");
    let end = FORMAT_40000.find("\t\t\t\t\t<max_isometric_force>").expect("end of path");
    let without_path = format!("{}{}", &FORMAT_40000[..start], &FORMAT_40000[end..]);
    assert!(matches!(problem(read(&without_path)).1, ProblemKind::TooFewPathPoints { found: 0 }));
    let (line, kind) = problem(with("<mass>1.5</mass>", ""));
    assert_eq!(
        (line, kind),
        (line_of("<Body name"), ProblemKind::Missing { property: "mass".to_owned(), expected: "a mass in kg" },)
    );
    let result = with("<socket_parent_frame>/ground</socket_parent_frame>", "");
    assert!(matches!(problem(result).1, ProblemKind::Missing { .. }));
    let odd = FORMAT_40000.replacen("<PathPoint ", "<Odd ", 1).replacen("</PathPoint>", "</Odd>", 1);
    let (line, kind) = problem(read(&odd));
    assert_eq!((line, kind), (line_of("<PathPoint "), ProblemKind::UnsupportedClass { class: "Odd".to_owned() }));
}

#[test]
fn verif_messages_say_where_what_and_found() {
    let error = with("<optimal_fiber_length>0.16<", "<optimal_fiber_length>-0.16<").expect_err("invalid");
    let expected = format!(
        "small.osim:{}: /forceset/BRD: optimal_fiber_length: expected a length greater than 0 m, found -0.16",
        line_of("<optimal_fiber_length>")
    );
    assert_eq!(error.to_string(), expected);
    let error = with("<coordinate>elbow_flexion<", "<coordinate>elbow_flexon<").expect_err("invalid");
    assert_eq!(error.hint().as_deref(), Some("did you mean \"elbow_flexion\"?"));
}

#[test]
fn verif_hints_are_paths_that_lead_somewhere() {
    let socket = "<socket_parent_frame>/bodyset/forearm</socket_parent_frame>";
    let hint = |written: &str| {
        let new = format!("<socket_parent_frame>{written}</socket_parent_frame>");
        with(socket, &new).expect_err("no such frame").hint().expect("a hint")
    };
    // The name alone, in another place, misspelt alone and in place: never what was written.
    for written in ["forearm", "/jointset/forearm", "foreram", "/bodyset/foreram"] {
        assert_eq!(hint(written), "did you mean \"/bodyset/forearm\"?", "{written}");
    }
    assert_eq!(hint("ground_offset"), "did you mean \"/jointset/elbow/ground_offset\"?");
}

#[test]
fn verif_a_component_set_is_read_like_the_sets_of_its_members() {
    let spring = |name: &str| {
        format!(
            "<SpringGeneralizedForce \
             name=\"{name}\"><coordinate>elbow_flexion</coordinate><stiffness>5</stiffness></SpringGeneralizedForce>"
        )
    };
    let set = format!(
        "<ComponentSet name=\"componentset\"><objects>{}<TableReporter name=\"r\"/><Odd \
         name=\"o\"/></objects></ComponentSet>\n</Model>",
        spring("s")
    );
    let file = with("</Model>", &set).expect("valid");
    let spring = file.spec.forces.iter().find(|f| f.name == "s").expect("read");
    assert_eq!(spring.at.path, "/componentset/s");
    assert!(!spring.at.is_in_force_set() && file.spec.muscles[0].at.is_in_force_set());
    assert!(file.spec.muscles[0].at.order() < spring.at.order());
    let unsupported: Vec<&str> = file.diagnostics.of(Severity::Unsupported).map(|d| d.path.as_str()).collect();
    assert_eq!(unsupported, ["/componentset/o"]);
}

#[test]
fn verif_a_negative_moment_of_inertia_is_warned_of() {
    let file = with("<inertia>0.001 0.01 0.01 0 0 0<", "<inertia>0.001 -0.01 0.01 0 0 0<").expect("valid");
    let warning = file.diagnostics.of(Severity::Warning).next().expect("a warning");
    assert!(warning.message.contains("principal moment of -1.000e-2") && warning.path == "/bodyset/forearm");
    assert_eq!(with("A & B", "A").expect("valid").diagnostics.of(Severity::Warning).count(), 0);
}

#[test]
fn verif_misspelt_properties_and_foreign_components_are_listed() {
    let file = with("<upper_limit>140</upper_limit>", "<uper_limit>140</uper_limit>").expect("valid");
    let warning = file.diagnostics.of(Severity::Warning).next().expect("a warning");
    assert_eq!(warning.hint.as_deref(), Some("did you mean <upper_limit>?"));
    let controller = "<ControllerSet><objects><PrescribedController name=\"c\"/></objects></ControllerSet>\n</Model>";
    let file = with("</Model>", controller).expect("valid");
    let unsupported = file.diagnostics.of(Severity::Unsupported).next().expect("unsupported");
    assert!(unsupported.message.contains("PrescribedController"), "{unsupported:?}");
    let json = serde_json::to_value(&file.diagnostics).expect("serializable");
    assert_eq!(json["understood"]["Millard2012EquilibriumMuscle"], 1);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    #[test]
    fn verif_damaged_files_never_panic(
        old in any::<bool>(),
        cut in any::<prop::sample::Index>(),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..8),
        moved in prop::option::of((any::<prop::sample::Index>(), any::<prop::sample::Index>(), 0usize..400)),
        truncate in any::<bool>(),
    ) {
        let mut bytes = if old { format_30000().into_bytes() } else { FORMAT_40000.as_bytes().to_vec() };
        for (at, byte) in changes {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        if let Some((from, to, length)) = moved {
            let from = from.index(bytes.len());
            let piece: Vec<u8> = bytes[from..].iter().copied().take(length).collect();
            let to = to.index(bytes.len());
            bytes.splice(to..to, piece);
        }
        if truncate {
            bytes.truncate(cut.index(bytes.len()));
        }
        match OsimFile::parse(bytes.clone(), "damaged.osim") {
            Ok(mut file) => {
                prop_assert_eq!(file.document.bytes(), &bytes[..]);
                let _ = file.set_muscle_property("BRD", "optimal_fiber_length", 0.2);
                let _ = file.set_muscle_property("BRD", "max_control", 0.5);
            }
            Err(error) => {
                let has_text = !error.to_string().is_empty();
                prop_assert!(has_text && error.hint().is_none_or(|hint| !hint.is_empty()));
            }
        }
    }
}

/// A set in a file of its own is read in its place (OpenSim: `Object::readObjectFromXMLNodeOrFile`), on the line that
/// names it; one of another format version, or that is not there, is named.
#[test]
fn verif_sets_in_files_of_their_own() {
    let text = include_str!("../../../fixtures/multibody/forces.osim");
    let (start, end) = (text.find("<ForceSet").expect("a set"), text.find("</ForceSet>").expect("its end") + 11);
    let version = text.split("Version=\"").nth(1).and_then(|rest| rest.split('"').next()).expect("a version");
    let folder = tempfile::tempdir().expect("folder");
    std::fs::create_dir(folder.path().join("sets")).expect("folder");
    let model = folder.path().join("model.osim");
    let outer = [&text[..start], "<ForceSet file=\"sets/forces.xml\"/>", &text[end..]].concat();
    std::fs::write(&model, &outer).expect("written");
    let write = |version: &str| {
        let inner = format!("<OpenSimDocument Version=\"{version}\">\n{}\n</OpenSimDocument>", &text[start..end]);
        std::fs::write(folder.path().join("sets/forces.xml"), inner).expect("written");
    };
    let names =
        |file: &OsimFile| file.spec.forces.iter().map(|f| (f.name.clone(), f.applies_force)).collect::<Vec<_>>();
    let refusals = |file: &OsimFile| {
        let all = file.diagnostics.of(Severity::Unsupported).filter(|d| d.message.contains("stands in another file"));
        all.map(|d| d.line).collect::<Vec<_>>()
    };
    write(version);
    let expected = OsimFile::parse(text, "forces.osim").expect("model");
    let found = OsimFile::read(&model).expect("model");
    assert!(!names(&expected).is_empty());
    assert_eq!((names(&found), refusals(&found)), (names(&expected), vec![]));
    let line = outer[..outer.find("<ForceSet").expect("a set")].lines().count();
    assert!(found.spec.forces.iter().all(|force| force.at.line == line), "lines stay what they are");
    write("30000");
    assert_eq!(refusals(&OsimFile::read(&model).expect("model")), vec![line]);
    std::fs::remove_file(folder.path().join("sets/forces.xml")).expect("removed");
    assert_eq!(refusals(&OsimFile::read(&model).expect("model")), vec![line]);
}
