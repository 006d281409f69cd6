//! Places of a surface with the positions where they should go, and the affine displacement that
//! fits them best.

use glam::{DMat3, DVec3};

use super::bilaplacian::Bilaplacian;

/// Weight against which the marks must prove an affine displacement: few or crowded marks do not
/// stretch a whole body.
const AFFINE_STIFFNESS: f64 = 100.0;

/// A place on a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Anchor {
    /// A vertex.
    Vertex(u32),
    /// A point of a triangle by its barycentric coordinates.
    Point {
        /// The triangle.
        triangle: u32,
        /// Coordinates, not negative, sum 1.
        barycentric: [f64; 3],
    },
}

/// A mark: where a place of the surface should go.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Constraint {
    /// The place.
    pub anchor: Anchor,
    /// Where it should go, in the mesh's unit.
    pub position: DVec3,
    /// How firmly; no unit. Zero: not at all.
    pub weight: f64,
    /// A mark that the user gave is never left out.
    pub trusted: bool,
}

/// A constraint on the corners of a triangle of the welded surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mark {
    pub(super) corners: [usize; 3],
    pub(super) barycentric: [f64; 3],
    pub(super) position: DVec3,
    pub(super) weight: f64,
    pub(super) trusted: bool,
}

impl Mark {
    pub(super) fn new(surface: &Bilaplacian, constraint: &Constraint) -> Self {
        let (mut corners, mut barycentric) = match constraint.anchor {
            Anchor::Vertex(vertex) => {
                let v = surface.stands_for[vertex as usize] as usize;
                ([v; 3], [1.0, 0.0, 0.0])
            }
            Anchor::Point { triangle, barycentric } => {
                (surface.welded.triangles()[triangle as usize].map(|v| v as usize), barycentric)
            }
        };
        // A corner that closing a seam repeated counts once.
        for (first, again) in [(0, 1), (0, 2), (1, 2)] {
            if corners[first] == corners[again] {
                barycentric[first] += barycentric[again];
                (corners[again], barycentric[again]) = (corners[first], 0.0);
            }
        }
        let Constraint { position, weight, trusted, .. } = *constraint;
        Self { corners, barycentric, position, weight, trusted }
    }

    /// Where the place lies among moved vertices.
    pub(super) fn at(&self, points: &[DVec3]) -> DVec3 {
        self.corners.iter().zip(self.barycentric).map(|(&v, b)| points[v] * b).sum()
    }
}

/// All vertices after the affine displacement that fits the kept marks.
pub(super) fn affine(surface: &Bilaplacian, marks: &[Mark], kept: &[bool]) -> Vec<DVec3> {
    let rest = surface.welded.vertices();
    let shares = &surface.shares;
    let centre: DVec3 = rest.iter().zip(shares).map(|(&p, &s)| p * s).sum();
    let spread: f64 = rest.iter().zip(shares).map(|(p, s)| s * p.distance_squared(centre)).sum();
    let marks: Vec<&Mark> = marks.iter().zip(kept).filter(|(_, k)| **k).map(|(m, _)| m).collect();
    let total: f64 = marks.iter().map(|mark| mark.weight).sum();
    if total <= 0.0 || spread <= 0.0 {
        return rest.to_vec();
    }
    let mean = marks.iter().map(|m| m.at(rest) * m.weight).sum::<DVec3>() / total;
    let outer = |a: DVec3, b: DVec3| DMat3::from_cols(a * b.x, a * b.y, a * b.z);
    let spreads: DMat3 = marks
        .iter()
        .map(|m| outer(m.at(rest) - mean, m.at(rest) - mean) * m.weight)
        .fold(DMat3::ZERO, |a, b| a + b);
    let ridge = DMat3::from_diagonal(DVec3::splat(AFFINE_STIFFNESS * spread / 3.0));
    let solver = (spreads + ridge).inverse();
    let (mut linear, mut shift) = (DMat3::ZERO, DVec3::ZERO);
    // Repeating the fit on what is left takes away the bias of the ridge where marks are many.
    for _ in 0..3 {
        let left = |m: &Mark| {
            let x = m.at(rest);
            m.position - x - (linear * (x - mean) + shift)
        };
        let step = marks.iter().map(|m| left(m) * m.weight).sum::<DVec3>() / total;
        let moment = marks
            .iter()
            .map(|m| outer(left(m) - step, m.at(rest) - mean) * m.weight)
            .fold(DMat3::ZERO, |a, b| a + b);
        linear += moment * solver;
        shift += step;
    }
    rest.iter().map(|&p| p + linear * (p - mean) + shift).collect()
}
