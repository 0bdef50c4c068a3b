//! Parts of the tree of bodies, so that a trial recomputes only what moves and matters.

use super::index::BaseIndex;
use super::model::Model;
use carpus_osim::osim::spec::{BodyIndex, CoordinateIndex};

/// Some bodies of one model, in an order in which they can be updated.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BodySubset {
    /// Tree nodes, ascending (the tree is sorted inboard to outboard).
    nodes: Vec<usize>,
    /// Whether each base is in the subset.
    contains: Vec<bool>,
}

impl BodySubset {
    fn from_nodes(model: &Model, keep: impl Fn(usize) -> bool) -> Self {
        let nodes: Vec<usize> = (0..model.nodes.len()).filter(|&i| keep(i)).collect();
        let mut contains = vec![false; model.n_bases()];
        nodes.iter().for_each(|&i| contains[model.nodes[i].outboard.0] = true);
        Self { nodes, contains }
    }

    pub(super) fn nodes(&self) -> &[usize] {
        &self.nodes
    }

    /// Whether a body is in the subset (ground never is).
    pub fn contains(&self, base: impl Into<BaseIndex>) -> bool {
        self.contains[base.into().0]
    }

    /// Number of bodies.
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Whether there is no body.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// The bodies of both subsets, which must be of the same model.
    pub fn intersection(&self, other: &BodySubset) -> BodySubset {
        let nodes = self.nodes.iter().copied().filter(|i| other.nodes.binary_search(i).is_ok()).collect();
        let contains = self.contains.iter().zip(&other.contains).map(|(a, b)| *a && *b).collect();
        BodySubset { nodes, contains }
    }

    /// The bodies of either subset, which must be of the same model.
    pub fn union(&self, other: &BodySubset) -> BodySubset {
        let mut nodes: Vec<usize> = self.nodes.iter().chain(&other.nodes).copied().collect();
        nodes.sort_unstable();
        nodes.dedup();
        let contains = self.contains.iter().zip(&other.contains).map(|(a, b)| *a || *b).collect();
        BodySubset { nodes, contains }
    }
}

impl Model {
    /// All bodies.
    pub fn all_bodies(&self) -> BodySubset {
        BodySubset::from_nodes(self, |_| true)
    }

    /// The given bodies and all bodies between them and ground: what must be updated to know their poses.
    pub fn body_subset(&self, bodies: &[BodyIndex]) -> BodySubset {
        let mut needed = vec![false; self.nodes.len()];
        for &body in bodies {
            let mut node = self.node_of_base[BaseIndex::from(body).0];
            while let Some(i) = node {
                needed[i] = true;
                node = self.node_of_base[self.nodes[i].inboard.0];
            }
        }
        BodySubset::from_nodes(self, |i| needed[i])
    }

    /// The bodies whose poses change when the given coordinates do, couplers followed. With the others up to date
    /// once, only the intersection of this with [`Model::body_subset`] needs updating while these coordinates move.
    pub fn bodies_moved_by(&self, coordinates: &[CoordinateIndex]) -> BodySubset {
        let moved_by = |own: CoordinateIndex| coordinates.iter().any(|&c| self.are_coupled(own, c));
        let mut moved = vec![false; self.nodes.len()];
        for (i, node) in self.nodes.iter().enumerate() {
            moved[i] = self.node_of_base[node.inboard.0].is_some_and(|inboard| moved[inboard])
                || node.mobilizer.coordinates().any(moved_by);
        }
        BodySubset::from_nodes(self, |i| moved[i])
    }

    /// Whether one of two bodies moves relative to the other when coordinate `c` does, couplers followed: whether a
    /// joint between them does.
    pub fn moves_between(&self, a: impl Into<BaseIndex>, b: impl Into<BaseIndex>, c: CoordinateIndex) -> bool {
        let (mut a, mut b) = (self.node_of_base[a.into().0], self.node_of_base[b.into().0]);
        // The tree is sorted: of two different nodes the later one is not inboard of the other.
        while a != b {
            let later = if a > b { &mut a } else { &mut b };
            let Some(node) = later.map(|i| &self.nodes[i]) else { break };
            if node.mobilizer.coordinates().any(|own| self.are_coupled(own, c)) {
                return true;
            }
            *later = self.node_of_base[node.inboard.0];
        }
        false
    }
}
