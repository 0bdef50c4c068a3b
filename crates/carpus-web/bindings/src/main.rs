//! Writes the JavaScript side of a WebAssembly module that was compiled with wasm-bindgen, and the module without what
//! only that needed.
//!
//! ```text
//! carpus-web-bindings MODULE.wasm FOLDER
//! ```

use std::error::Error;

use wasm_bindgen_cli_support::Bindgen;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(module), Some(folder)) = (arguments.next(), arguments.next()) else {
        return Err("expected MODULE.wasm and the folder that bindings are written to".into());
    };
    let mut bindgen = Bindgen::new();
    bindgen.input_path(module).web(true)?.typescript(false).omit_default_module_path(true);
    bindgen.generate(folder)?;
    Ok(())
}
