//! What a truncated sum leaves out (eq. 17 beyond its first K terms).
//!
//! The part of the Green's function that the first K eigenpairs do not hold, t(x, y) =
//! Σ_{k>K} φ_k(x) φ_k(y) / λ_k², has a known diagonal: the exact g(x, x) less its truncation. Off
//! the diagonal it falls with the distance r of x and y, by Weyl's law in the plane as
//! ρ(r √λ_K) with ρ(s) = ∫₁^∞ J₀(s √u) / u² du = 2 s² ∫_s^∞ J₀(v) / v³ dv.
//! So t(x, y) ≈ √(t(x, x) t(y, y)) ρ, which makes far pairs nearly exact and takes most of the
//! error from near ones.

/// Step of the table of ρ.
const STEP: f64 = 0.02;
/// Argument beyond which ρ, below 1e-3 and oscillating, counts as zero.
const LAST: f64 = 30.0;

/// The table of ρ.
pub(super) struct TailCorrelation {
    values: Vec<f64>,
}

impl TailCorrelation {
    pub(super) fn new() -> Self {
        // Simpson's rule, from the far end, where the rest of the integral is below the table's
        // own error, to the near one.
        let count = (LAST / STEP) as usize;
        let integrand = |v: f64| libm::j0(v) / (v * v * v);
        let mut values = vec![0.0; count + 1];
        let mut integral = 0.0;
        for i in (1..=count).rev() {
            let s = i as f64 * STEP;
            if i < count {
                // J₀ is smooth but 1/v³ is not near 0: fine sub-steps keep the rule exact there.
                const PARTS: usize = 8;
                let h = STEP / PARTS as f64;
                for part in 0..PARTS {
                    let v = s + part as f64 * h;
                    integral += h / 6.0 * (integrand(v) + 4.0 * integrand(v + 0.5 * h) + integrand(v + h));
                }
            }
            values[i] = (2.0 * s * s * integral).clamp(-1.0, 1.0);
        }
        values[0] = 1.0;
        Self { values }
    }

    /// ρ(s) for s ≥ 0.
    pub(super) fn at(&self, s: f64) -> f64 {
        let position = s / STEP;
        let below = position as usize;
        match (self.values.get(below), self.values.get(below + 1)) {
            (Some(a), Some(b)) => a + (b - a) * (position - below as f64),
            _ => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn follows_the_integral_over_the_spectrum() {
        let tail = TailCorrelation::new();
        assert_eq!(tail.at(0.0), 1.0);
        assert_eq!(tail.at(1e9), 0.0);
        for s in [0.1, 0.5, 1.0, 2.0, 5.0, 10.0] {
            // Substituting u = 1/w turns the definition into an integral over (0, 1].
            let steps = 400_000;
            let h = 1.0 / f64::from(steps);
            let sum: f64 = (0..steps).map(|i| libm::j0(s / ((f64::from(i) + 0.5) * h).sqrt()) * h).sum();
            assert!((tail.at(s) - sum).abs() < 1e-3, "{s}: {} {sum}", tail.at(s));
        }
    }
}
