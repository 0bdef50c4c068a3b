//! Joints that close loops, as OpenSim finds them.

use super::location::{BodyIndex, FrameIndex, JointIndex};
use super::{FrameKind, JointKind, ModelSpec};

/// A joint between two bodies, ground being 0 and a body its index + 1.
#[derive(Clone, Copy)]
struct Link {
    parent: usize,
    child: usize,
    is_weld: bool,
}

/// A tree that grows outward from ground (Simbody's `MultibodyGraphMaker`).
struct Tree<'a> {
    links: &'a [Link],
    /// Mass of every body [kg].
    mass: Vec<f64>,
    /// Number of joints between ground and every body; `None`: not in the tree.
    level: Vec<Option<usize>>,
    /// Level of the outer body of every joint that is in the tree.
    used: Vec<Option<usize>>,
}

impl ModelSpec {
    /// The joints that close loops of joints, in the order of the model: those that OpenSim cuts at their child.
    pub fn loop_joints(&self) -> Vec<JointIndex> {
        let base = |frame: FrameIndex| self.base_of(frame).map_or(0, |body| body.0 + 1);
        let link = |joint: &super::JointSpec| Link {
            parent: base(joint.parent_frame),
            child: base(joint.child_frame),
            is_weld: matches!(joint.kind, JointKind::Weld),
        };
        let links: Vec<Link> = self.joints.iter().map(link).collect();
        let n = self.bodies.len() + 1;
        let mass = std::iter::once(0.0).chain(self.bodies.iter().map(|body| body.mass)).collect();
        let mut tree = Tree { links: &links, mass, level: vec![None; n], used: vec![None; links.len()] };
        tree.level[0] = Some(0);
        loop {
            tree.grow();
            // What hangs together without any connection to ground gets one.
            match tree.next_base() {
                Some(body) => tree.level[body] = Some(1),
                None => break,
            }
        }
        // A joint within one body is an error of its own.
        let closes = |i: &usize| tree.used[*i].is_none() && links[*i].parent != links[*i].child;
        (0..links.len()).filter(closes).map(JointIndex).collect()
    }

    /// The body that a frame is fixed to; `None` for ground, or parents that lead nowhere.
    pub fn base_of(&self, mut frame: FrameIndex) -> Option<BodyIndex> {
        for _ in 0..=self.frames.len() {
            match self.frames.get(frame.0)?.kind {
                FrameKind::Ground => return None,
                FrameKind::Body(body) => return (body.0 < self.bodies.len()).then_some(body),
                FrameKind::Offset { parent, .. } => frame = parent,
            }
        }
        None
    }
}

impl Tree<'_> {
    /// Adds joints level by level, in the order of the model.
    fn grow(&mut self) {
        for level in 1.. {
            let mut added = false;
            for i in 0..self.links.len() {
                if let Some(own) = self.used[i] {
                    added |= own == level;
                    continue;
                }
                let Link { parent, child, is_weld } = self.links[i];
                let inner = match (self.level[parent], self.level[child]) {
                    (Some(inner), None) | (None, Some(inner)) => inner,
                    _ => continue,
                };
                if inner + 1 != level {
                    continue;
                }
                let outer = self.add(i);
                added = true;
                if !is_weld {
                    self.add_until_massive(outer);
                }
            }
            if !added {
                return;
            }
        }
    }

    /// Adds a joint of which one body is in the tree; the other one is returned.
    fn add(&mut self, i: usize) -> usize {
        let Link { parent, child, .. } = self.links[i];
        let (inner, outer) = if self.level[parent].is_some() { (parent, child) } else { (child, parent) };
        let level = self.level[inner].map(|level| level + 1);
        (self.level[outer], self.used[i]) = (level, level);
        outer
    }

    /// A branch must not end with a body that has no mass: it grows on until one has.
    fn add_until_massive(&mut self, mut body: usize) {
        while self.mass[body] <= 0.0 {
            let is_free = |(i, other): &(usize, usize)| self.used[*i].is_none() && self.level[*other].is_none();
            // Of those with mass the heaviest: as child, or else as parent.
            let heaviest = |candidates: Vec<(usize, usize)>| {
                let massive = candidates.into_iter().filter(|c| is_free(c) && self.mass[c.1] > 0.0);
                massive.fold(None, |best: Option<(usize, usize)>, c| match best {
                    Some(best) if self.mass[best.1] >= self.mass[c.1] => Some(best),
                    _ => Some(c),
                })
            };
            let links = || self.links.iter().enumerate();
            let children = links().filter(|(_, link)| link.parent == body).map(|(i, link)| (i, link.child)).collect();
            let parents = links().filter(|(_, link)| link.child == body).map(|(i, link)| (i, link.parent)).collect();
            let Some((i, _)) = heaviest(children).or_else(|| heaviest(parents)) else { return };
            body = self.add(i);
        }
    }

    /// The body outside of the tree that is to be joined to ground: one that is nobody's child, of those the one with
    /// the most children.
    fn next_base(&self) -> Option<usize> {
        let children = |body: usize| self.links.iter().filter(|link| link.parent == body).count();
        let is_child = |body: usize| self.links.iter().any(|link| link.child == body);
        let outside = || (1..self.level.len()).filter(|body| self.level[*body].is_none());
        let first_of_most = |bodies: Vec<usize>| {
            bodies.into_iter().fold(None, |best: Option<usize>, body| match best {
                Some(best) if children(best) >= children(body) => Some(best),
                _ => Some(body),
            })
        };
        first_of_most(outside().filter(|body| !is_child(*body)).collect())
            .or_else(|| first_of_most(outside().collect()))
    }
}
