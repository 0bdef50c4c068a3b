//! Mechanics of a model: coordinates and kinematics, paths of muscles, muscles, other forces, equations of motion.

pub mod dynamics;
pub mod forces;
pub mod multibody;
pub mod muscles;
pub mod paths;
