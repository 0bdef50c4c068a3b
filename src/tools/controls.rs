//! Controls over time: `PrescribedController` of a model or setup, `ControlSetController` with linear controls.

use super::error::ToolError;
use super::setup::{Properties, Setup};
use crate::functions::Function;
use crate::osim::spec::FunctionSpec;
use crate::storage::Storage;

/// Controls by the names of actuators.
#[derive(Clone, Debug, Default)]
pub struct Controls(Vec<(String, Function)>);

impl Controls {
    /// Control of an actuator at a time, if it is controlled; those of several controllers add up.
    pub fn at(&self, actuator: &str, time: f64) -> Option<f64> {
        let own = self.0.iter().filter(|(name, _)| name == actuator);
        own.map(|(_, function)| function.value(time)).reduce(|sum, value| sum + value)
    }

    /// Reads a `ControllerSet`.
    ///
    /// - `actuators`: names of all actuators, in order
    ///
    /// # Errors
    /// A class that is not supported, functions that cannot be built.
    pub fn read(&mut self, controllers: &[Properties], actuators: &[String]) -> Result<(), ToolError> {
        for controller in controllers {
            let enabled = match controller.text("isDisabled") {
                Some(_) => !controller.boolean("isDisabled", false)?,
                None => controller.boolean("enabled", true)?,
            };
            if !enabled {
                controller.ignore();
                continue;
            }
            match controller.class() {
                "PrescribedController" => self.prescribed(controller, actuators)?,
                "ControlSetController" => self.control_set(controller)?,
                class => {
                    return Err(
                        controller.unsupported(class, "controllers are PrescribedController and ControlSetController")
                    );
                }
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
            for (i, label) in storage.labels.iter().enumerate() {
                let spec = FunctionSpec::PiecewiseLinear { x: storage.time.clone(), y: storage.column(i) };
                let function = Function::compile(&spec).map_err(|e| controller.error_at("controls_file", e))?;
                self.0.push((last(label), function));
            }
        }
        controller.ignore_all(&["interpolation_method"]);
        let functions = controller.objects("ControlFunctions");
        for (i, function) in functions.iter().enumerate() {
            let own = function.name();
            // By name, else by position.
            let actuator = if list.contains(&own) { own } else { list.get(i).cloned().unwrap_or(own) };
            self.0.push((actuator, read_function(function)?));
        }
        Ok(())
    }

    fn control_set(&mut self, controller: &Properties) -> Result<(), ToolError> {
        controller.ignore_all(&["actuator_list", "socket_actuators"]);
        let Some(file) = controller.file("controls_file") else {
            return Err(controller.missing("controls_file", "a file of controls (.xml or .sto)"));
        };
        if !file.extension().is_some_and(|e| e.eq_ignore_ascii_case("xml")) {
            let storage = Storage::read(&file)?;
            for (i, label) in storage.labels.iter().enumerate() {
                let spec = FunctionSpec::PiecewiseLinear { x: storage.time.clone(), y: storage.column(i) };
                let function = Function::compile(&spec).map_err(|e| controller.error_at("controls_file", e))?;
                self.0.push((label.trim_end_matches(".excitation").to_owned(), function));
            }
            return Ok(());
        }
        let setup = Setup::read(&file)?;
        for control in setup.object().objects("") {
            match control.class() {
                "ControlLinear" | "ControlConstant" => {}
                class => return Err(control.unsupported(class, "controls are ControlLinear and ControlConstant")),
            }
            let name = control.name();
            let name = name.trim_end_matches(".excitation").to_owned();
            if control.class() == "ControlConstant" {
                self.0.push((name, Function::constant(control.number("value", 0.0)?)));
                continue;
            }
            let (mut x, mut y) = (Vec::new(), Vec::new());
            let nodes = match control.objects("x_nodes") {
                nodes if nodes.is_empty() => control.objects("nodes"),
                nodes => nodes,
            };
            for node in nodes {
                x.push(node.number("t", 0.0)?);
                y.push(node.number("value", 0.0)?);
            }
            let function = match x.len() {
                0 => continue,
                1 => Function::constant(y[0]),
                _ if control.boolean("use_steps", false)? => {
                    // The value of a node holds until its time.
                    let (x, y) = (x[..x.len() - 1].to_vec(), y[1..].to_vec());
                    Function::compile(&FunctionSpec::PiecewiseConstant { x, y })
                        .map_err(|e| control.error_at("x_nodes", e))?
                }
                _ => Function::compile(&FunctionSpec::PiecewiseLinear { x, y })
                    .map_err(|e| control.error_at("x_nodes", e))?,
            };
            self.0.push((name, function));
        }
        Ok(())
    }
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
