//! Quadrature over the diameters of a class of drops.

use squall_formats::drops;
use squall_formats::units::Millimetres;
use squall_runtime::transport::quadrature::gauss_legendre;

/// Gauss and Legendre's rule on [−1, 1].
pub(crate) struct GaussRule {
    points: Vec<(f64, f64)>,
}

impl GaussRule {
    /// `count` points and weights.
    pub fn new(count: usize) -> Self {
        Self { points: gauss_legendre(count) }
    }

    pub fn over(&self, from: f64, to: f64, f: &impl Fn(f64) -> f64) -> f64 {
        let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
        self.points.iter().map(|(x, weight)| weight * f(middle + half * x)).sum::<f64>() * half
    }

    /// ∫ f dD over a class: in two where the fall speed jumps inside it, and each in pieces short enough
    /// that one class over all diameters keeps every digit too.
    pub fn over_class(&self, from: Millimetres, to: Millimetres, f: impl Fn(f64) -> f64) -> f64 {
        let cut = drops::BEST_BELOW.0.clamp(from.0, to.0);
        [[from.0, cut], [cut, to.0]]
            .iter()
            .filter(|[low, high]| low < high)
            .flat_map(|&[low, high]| drops::log_classes(Millimetres(low), Millimetres(high), 4))
            .map(|[low, high]| self.over(low.0, high.0, &f))
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gauss_points_integrate_polynomials_and_exponentials_to_round_off() {
        let rule = GaussRule::new(24);
        let exact = (1.0 - libm::exp(-9.0)) / 3.0;
        let found = rule.over(0.0, 3.0, &|x| libm::exp(-3.0 * x));
        assert!((found / exact - 1.0).abs() < 1e-14);
        assert!((rule.over(-1.0, 2.0, &|x| x * x * x * x) - 6.6).abs() < 1e-13);
    }
}
