//! The compiled, immutable multibody model: coordinates, joints, couplers, kinematics.
