//! Controls over time: `PrescribedController` of a model or setup, `ControlSetController` with linear controls.

use super::correction::ELSEWHERE;
use super::error::{ToolError, ToolProblem};
use super::finite_columns::require_finite;
use super::result::Outcome;
use super::setup::{Properties, Setup};
use carpus_osim::functions::Function;
use carpus_osim::osim::spec::FunctionSpec;
use carpus_osim::storage::Storage;

/// Controllers that are read.
const CONTROLLERS: &str = "controllers are PrescribedController, ControlSetController and, in a ForwardTool's setup, \
                           CorrectionController";

/// Controls by the names of actuators.
#[derive(Clone, Debug, Default)]
pub struct Controls(Vec<(String, Control)>);

/// A control over time.
#[derive(Clone, Debug)]
enum Control {
    Function(Function),
    /// A function that goes on after its last and before its first node as there.
    Held {
        function: Function,
        from: f64,
        to: f64,
    },
    /// The value of every node holds from the node before it, exclusive, to its own time.
    Steps {
        time: Vec<f64>,
        value: Vec<f64>,
    },
}

impl Control {
    fn at(&self, time: f64) -> f64 {
        match self {
            Control::Function(function) => function.value(time),
            Control::Held { function, from, to } => function.value(time.clamp(*from, *to)),
            Control::Steps { time: nodes, value } => {
                value[nodes.partition_point(|node| *node < time).min(nodes.len() - 1)]
            }
        }
    }
}

impl Controls {
    /// Control of an actuator at a time, if it is controlled; those of several controllers add up.
    pub fn at(&self, actuator: &str, time: f64) -> Option<f64> {
        let own = self.0.iter().filter(|(name, _)| name == actuator);
        own.map(|(_, control)| control.at(time)).reduce(|sum, value| sum + value)
    }

    /// Reads a `ControllerSet`.
    ///
    /// A `ControlSetController` is enabled by its file, whatever it says itself.
    ///
    /// - `actuators`: names of all actuators, in order
    ///
    /// # Errors
    /// A class that is not supported, functions that cannot be built, controls of actuators that there are not.
    pub fn read(
        &mut self,
        controllers: &[Properties],
        actuators: &[String],
        outcome: &mut Outcome,
    ) -> Result<(), ToolError> {
        for controller in controllers {
            controller.ignore_all(&["enable_controller"]);
            if !controller.is_enabled()? && controller.class() != "ControlSetController" {
                controller.ignore();
                continue;
            }
            match controller.class() {
                "PrescribedController" => self.prescribed(controller, actuators)?,
                "ControlSetController" => self.control_set(controller, actuators, outcome)?,
                class @ "CorrectionController" => return Err(controller.unsupported(class, ELSEWHERE)),
                class => return Err(controller.unsupported(class, CONTROLLERS)),
            }
        }
        Ok(())
    }

    fn prescribed(&mut self, controller: &Properties, actuators: &[String]) -> Result<(), ToolError> {
        let named = controller.words("actuator_list").unwrap_or_default();
        let sockets = controller.words("socket_actuators").unwrap_or_default();
        let last = |path: &String| path.rsplit('/').next().unwrap_or_default().to_owned();
        let mut list: Vec<String> = named.iter().chain(&sockets).map(last).collect();
        if list.first().is_some_and(|first| first.eq_ignore_ascii_case("ALL")) {
            list = actuators.to_vec();
        }
        if let Some(file) = controller.file("controls_file") {
            let storage = Storage::read(&file)?;
            let method = controller.integer("interpolation_method", 1)?;
            for (i, label) in storage.labels.iter().enumerate() {
                let actuator = last(label);
                if list.contains(&actuator) {
                    continue;
                }
                require(&actuator, actuators, controller)?;
                require_finite(&storage, &[i], &file)?;
                let (x, y) = (storage.time.clone(), storage.column(i));
                let spec = match method {
                    0 => FunctionSpec::PiecewiseConstant { x, y },
                    1 | 3 | 5 | 7 => FunctionSpec::GcvSpline {
                        half_order: (method as usize).div_ceil(2),
                        error_variance: 0.0,
                        weights: vec![1.0; x.len()],
                        x,
                        y,
                    },
                    other => {
                        let expected = "0 (constant) or the degree of a spline: 1, 3, 5 or 7";
                        return Err(controller.bad_value("interpolation_method", expected, &other.to_string()));
                    }
                };
                self.add_column(&actuator, &spec, controller)?;
            }
        }
        let functions = controller.objects("ControlFunctions");
        if functions.len() != list.len() {
            let expected = format!("one function for each of {} actuators (actuator_list)", list.len());
            return Err(controller.bad_value("ControlFunctions", &expected, &functions.len().to_string()));
        }
        // By position, whatever the functions are called.
        for (function, actuator) in functions.iter().zip(list) {
            require(&actuator, actuators, controller)?;
            self.0.push((actuator, Control::Function(read_function(function)?)));
        }
        Ok(())
    }

    /// Adds what a column of a controller's file says over time.
    fn add_column(&mut self, actuator: &str, spec: &FunctionSpec, controller: &Properties) -> Result<(), ToolError> {
        let function = Function::compile(spec).map_err(|e| controller.error_at("controls_file", e))?;
        self.0.push((actuator.to_owned(), Control::Function(function)));
        Ok(())
    }

    fn control_set(
        &mut self,
        controller: &Properties,
        actuators: &[String],
        outcome: &mut Outcome,
    ) -> Result<(), ToolError> {
        controller.ignore_all(&["actuator_list", "socket_actuators", "enabled", "isDisabled"]);
        let Some(file) = controller.file("controls_file") else {
            return Err(controller.missing("controls_file", "a file of controls (.xml or .sto)"));
        };
        if !file.extension().is_some_and(|e| e.eq_ignore_ascii_case("xml")) {
            let storage = Storage::read(&file)?;
            for (i, label) in storage.labels.iter().enumerate() {
                let actuator = label.strip_suffix(".excitation").unwrap_or(label);
                require(actuator, actuators, controller)?;
                require_finite(&storage, &[i], &file)?;
                let spec = FunctionSpec::PiecewiseLinear { x: storage.time.clone(), y: storage.column(i) };
                self.add_column(actuator, &spec, controller)?;
            }
            return Ok(());
        }
        let setup = Setup::read(&file)?;
        let controls = setup.object().objects("");
        let mut model_controls = 0;
        for control in &controls {
            let is_one = control.boolean("is_model_control", control.class() != "ControlConstant")?;
            model_controls += usize::from(is_one);
        }
        for (i, control) in controls.iter().enumerate() {
            let name = control.name();
            let name = name.strip_suffix(".excitation").unwrap_or(&name);
            if i >= model_controls {
                let text = format!(
                    "the control of {name} is left out, as in OpenSim 4.6: it counts the controls with \
                     is_model_control ({model_controls}; a ControlConstant has it only if it says so) and takes as \
                     many from the first on"
                );
                outcome.warn(&file, control.line(), text);
                continue;
            }
            require(name, actuators, control)?;
            let read = match control.class() {
                "ControlLinear" => control_linear(control)?,
                "ControlConstant" => Control::Function(Function::constant(control.number("value", 0.0)?)),
                class => return Err(control.unsupported(class, "controls are ControlLinear and ControlConstant")),
            };
            self.0.push((name.to_owned(), read));
        }
        Ok(())
    }
}

/// A `ControlLinear`: straight or in steps between its nodes.
fn control_linear(control: &Properties) -> Result<Control, ToolError> {
    let (mut time, mut value) = (Vec::new(), Vec::new());
    for node in ["x_nodes", "nodes"].iter().flat_map(|list| control.members(list)) {
        time.push(node.number("t", 0.0)?);
        value.push(node.number("value", 0.0)?);
    }
    let (Some(&from), Some(&to)) = (time.first(), time.last()) else {
        return Err(control.missing("x_nodes", "nodes: <ControlLinearNode> with <t> and <value>"));
    };
    if !time.is_sorted() || !from.is_finite() || !to.is_finite() {
        return Err(control.bad_value("x_nodes", "nodes of ascending times", &format!("{time:?}")));
    }
    if control.boolean("use_steps", false)? {
        return Ok(Control::Steps { time, value });
    }
    let extrapolate = control.boolean("extrapolate", true)?;
    if value.len() == 1 {
        return Ok(Control::Function(Function::constant(value[0])));
    }
    let spec = FunctionSpec::PiecewiseLinear { x: time, y: value };
    let function = Function::compile(&spec).map_err(|e| control.error_at("x_nodes", e))?;
    Ok(if extrapolate { Control::Function(function) } else { Control::Held { function, from, to } })
}

/// Fails if there is no actuator of this name, as OpenSim does.
///
/// - `whose`: the controller or control that names it
fn require(name: &str, actuators: &[String], whose: &Properties) -> Result<(), ToolError> {
    if actuators.iter().any(|a| a == name) {
        return Ok(());
    }
    let nearest = carpus_osim::osim::error::nearest(name, actuators.iter().map(String::as_str));
    let problem = ToolProblem::Unknown { kind: "actuator", name: name.to_owned(), nearest };
    Err(whose.error_at("controls_file", problem))
}

/// Reads a function object.
fn read_function(function: &Properties) -> Result<Function, ToolError> {
    let numbers = |property: &str| -> Result<Vec<f64>, ToolError> {
        let words = function.words(property).unwrap_or_default();
        words.iter().map(|w| w.parse().map_err(|_| function.bad_value(property, "numbers", w))).collect()
    };
    let spec = match function.class() {
        "Constant" => FunctionSpec::Constant { value: function.number("value", 0.0)? },
        "LinearFunction" => {
            let [slope, intercept] = function.numbers("coefficients", [1.0, 0.0])?;
            FunctionSpec::Linear { slope, intercept }
        }
        "PiecewiseLinearFunction" => FunctionSpec::PiecewiseLinear { x: numbers("x")?, y: numbers("y")? },
        "PiecewiseConstantFunction" => FunctionSpec::PiecewiseConstant { x: numbers("x")?, y: numbers("y")? },
        "SimmSpline" | "NaturalCubicSpline" => FunctionSpec::SimmSpline { x: numbers("x")?, y: numbers("y")? },
        "StepFunction" => FunctionSpec::Step {
            start_time: function.number("transition_start_time", -1.0)?,
            end_time: function.number("transition_end_time", 1.0)?,
            start_value: function.number("start_value", 0.0)?,
            end_value: function.number("end_value", 1.0)?,
        },
        "Sine" => FunctionSpec::Sine {
            amplitude: function.number("amplitude", 1.0)?,
            omega: function.number("omega", 1.0)?,
            phase: function.number("phase", 0.0)?,
            offset: function.number("offset", 0.0)?,
        },
        "GCVSpline" => FunctionSpec::GcvSpline {
            half_order: function.integer("half_order", 3)?.max(0) as usize,
            error_variance: function.number("error_variance", 0.0)?,
            x: numbers("x")?,
            y: numbers("y")?,
            weights: numbers("weights")?,
        },
        class => return Err(function.unsupported(class, "expected a function of one variable")),
    };
    Function::compile(&spec).map_err(|e| function.error_at("x", e))
}
