//! Truncated eigenbasis of one piece, arranged for distances of vertex pairs in O(K).

use glam::DVec3;

use super::SpectralError;
use super::component::Component;
use super::tail::TailCorrelation;

/// Vertices of a piece as points φ_k(x) / λ_k, whose Euclidean distance is the truncated
/// biharmonic distance (eq. 17), with what is needed to estimate the rest.
pub(super) struct Embedding {
    pub(super) eigenvalues: Vec<f64>,
    /// A row of K coordinates per vertex.
    rows: Vec<f64>,
    positions: Vec<DVec3>,
    /// √t(x, x): root of the Green's function's diagonal beyond the basis.
    tails: Vec<f64>,
}

impl Embedding {
    pub(super) fn new(
        component: &Component,
        positions: Vec<DVec3>,
        count: usize,
        report: &mut dyn FnMut(f64) -> bool,
    ) -> Result<Self, SpectralError> {
        let pairs = component.eigenpairs(count, report)?;
        let (count, vertex_count) = (pairs.values.len(), component.vertex_count());
        let mut rows = vec![0.0; count * vertex_count];
        for (k, lambda) in pairs.values.iter().enumerate() {
            for v in 0..vertex_count {
                rows[v * count + k] = pairs.vectors[k * vertex_count + v] / lambda;
            }
        }
        let exact = component.green_diagonal()?;
        let tail = |(v, g): (usize, &f64)| {
            let truncated: f64 = rows[v * count..(v + 1) * count].iter().map(|c| c * c).sum();
            (g - truncated).max(0.0).sqrt()
        };
        let tails = exact.iter().enumerate().map(tail).collect();
        Ok(Self { eigenvalues: pairs.values, rows, positions, tails })
    }

    pub(super) fn distance(&self, x: u32, y: u32, correlation: &TailCorrelation) -> f64 {
        let (x, y) = (x as usize, y as usize);
        let count = self.eigenvalues.len();
        let row = |v: usize| &self.rows[v * count..(v + 1) * count];
        let truncated: f64 = row(x).iter().zip(row(y)).map(|(a, b)| (a - b) * (a - b)).sum();
        let last = self.eigenvalues.last().copied().unwrap_or(0.0);
        let correlation = correlation.at(self.positions[x].distance(self.positions[y]) * last.sqrt());
        let (a, b) = (self.tails[x], self.tails[y]);
        (truncated + a * a + b * b - 2.0 * a * b * correlation).max(0.0).sqrt()
    }
}
