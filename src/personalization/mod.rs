//! Fitting muscle parameters to recorded trials, and writing them back into the model file.
