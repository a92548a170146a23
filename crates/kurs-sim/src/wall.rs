//! Walls: what is diffracted round their edges and what they reflect.

use nalgebra::{Complex, Vector2, Vector3};

use crate::diffraction::knife_edge;
use crate::received_field::ReceivedField;
use crate::scenario;

/// An upright opaque rectangle that reaches down into the ground; north, east, down from the origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Wall {
    /// One end, on the level of the origin.
    from_m: Vector3<f64>,
    /// Along the wall to the other end, level.
    along: Vector3<f64>,
    /// At right angles to it, level.
    normal: Vector3<f64>,
    width_m: f64,
    height_m: f64,
    reflection: f64,
}

/// What a wall does to the signal of one satellite at one antenna, for any wavelength.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum WallEffect {
    /// It stands before the satellite, or beside the way to it.
    Before(Outline),
    /// It stands behind the antenna and throws the signal back to it.
    Echo {
        /// The wall as the image of the antenna behind it sees it.
        outline: Outline,
        /// How much longer the way is.
        delay_m: f64,
        /// Amplitude thrown back.
        reflection: f64,
    },
}

/// Top and sides of a wall against the point where the way of a signal passes its plane: distances h
/// as h √(2/d), so that v = outline / √λ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Outline {
    top: f64,
    left: f64,
    right: f64,
}

impl Wall {
    /// From a checked plan.
    pub(crate) fn new(plan: &scenario::Wall) -> Self {
        let [from, to] = [plan.from_m, plan.to_m].map(|[east, north]| Vector2::new(north, east));
        let along = (to - from).normalize();
        Self {
            from_m: Vector3::new(from.x, from.y, 0.0),
            along: Vector3::new(along.x, along.y, 0.0),
            normal: Vector3::new(-along.y, along.x, 0.0),
            width_m: (to - from).norm(),
            height_m: plan.height_m,
            reflection: plan.reflection,
        }
    }

    /// What it does to a signal from `line_of_sight` at an antenna; both north, east, down.
    pub(crate) fn effect(
        &self,
        antenna_m: &Vector3<f64>,
        line_of_sight: &Vector3<f64>,
    ) -> Option<WallEffect> {
        let before_m = (self.from_m - antenna_m).dot(&self.normal);
        if before_m * line_of_sight.dot(&self.normal) > 0.0 {
            return self.outline(antenna_m, line_of_sight).map(WallEffect::Before);
        }
        if self.reflection == 0.0 {
            return None;
        }
        let image_m = antenna_m + self.normal * (2.0 * before_m);
        let outline = self.outline(&image_m, line_of_sight)?;
        let delay_m = (antenna_m - image_m).dot(line_of_sight);
        Some(WallEffect::Echo { outline, delay_m, reflection: self.reflection })
    }

    /// None along the wall.
    fn outline(&self, from_m: &Vector3<f64>, line_of_sight: &Vector3<f64>) -> Option<Outline> {
        /// Below this sine the way runs along the wall.
        const GRAZING: f64 = 1e-6;
        let across = line_of_sight.dot(&self.normal);
        let distance_m = (self.from_m - from_m).dot(&self.normal) / across;
        if across.abs() < GRAZING || distance_m <= 0.0 {
            return None;
        }
        let passed_m = from_m + line_of_sight * distance_m;
        let (along_m, up_m) = ((passed_m - self.from_m).dot(&self.along), -passed_m.z);
        // The shortest way from a skew line, in the plane at right angles to the edge.
        let scale = (2.0 / distance_m).sqrt() * across.abs();
        let to_level_edge = scale / line_of_sight.cross(&self.along).norm();
        let to_upright_edge = scale / line_of_sight.xy().norm();
        Some(Outline {
            top: (self.height_m - up_m) * to_level_edge,
            left: -along_m * to_upright_edge,
            right: (self.width_m - along_m) * to_upright_edge,
        })
    }
}

impl Outline {
    /// What the wall takes out of the field of a plane wave, or throws back of it: the product of what
    /// a strip from the ground to its top and a strip between its sides would.
    fn covered(&self, wavelength_m: f64) -> Complex<f64> {
        let scale = wavelength_m.sqrt().recip();
        let below_top = Complex::new(1.0, 0.0) - knife_edge(self.top * scale);
        below_top * (knife_edge(self.left * scale) - knife_edge(self.right * scale))
    }
}

/// The field behind and between walls.
pub(crate) fn field(effects: &[WallEffect], wavelength_m: f64) -> ReceivedField {
    let mut straight = Complex::new(1.0, 0.0);
    for effect in effects {
        if let WallEffect::Before(outline) = effect {
            straight *= Complex::new(1.0, 0.0) - outline.covered(wavelength_m);
        }
    }
    let mut field = ReceivedField::straight(straight);
    for effect in effects {
        if let WallEffect::Echo { outline, delay_m, reflection } = effect {
            let echo = outline.covered(wavelength_m) * *reflection;
            field.add_delayed(echo, *delay_m, wavelength_m);
        }
    }
    field
}

#[cfg(test)]
mod tests {
    use super::*;

    const L1_M: f64 = 0.190_293_672_798_364_9;

    /// Ten metres high and 200 wide, ten metres north of the origin.
    fn wall(reflection: f64) -> Wall {
        let plan = scenario::Wall {
            from_m: [-100.0, 10.0],
            to_m: [100.0, 10.0],
            height_m: 10.0,
            reflection,
        };
        Wall::new(&plan)
    }

    fn sight(azimuth_deg: f64, elevation_deg: f64) -> Vector3<f64> {
        let (sin_a, cos_a) = azimuth_deg.to_radians().sin_cos();
        let (sin_e, cos_e) = elevation_deg.to_radians().sin_cos();
        Vector3::new(cos_e * cos_a, cos_e * sin_a, -sin_e)
    }

    fn received(wall: &Wall, azimuth_deg: f64, elevation_deg: f64) -> ReceivedField {
        let effect = wall.effect(&Vector3::zeros(), &sight(azimuth_deg, elevation_deg));
        field(effect.as_slice(), L1_M)
    }

    /// At 45° the way touches the top: 6 dB; two degrees lower the edge stands
    /// h = 10√2 sin 2° = 0.494 m above it at d = 10/cos 43° m: v = h √(2/(λd)) = 0.43.
    #[test]
    fn satellites_set_behind_the_top() {
        let touching = received(&wall(0.0), 0.0, 45.0);
        assert!((touching.loss_db() - 6.02).abs() < 0.2, "{touching:?}");
        let below = received(&wall(0.0), 0.0, 43.0);
        let h_m = 10.0 * 2f64.sqrt() * 2f64.to_radians().sin();
        let d_m = 10.0 / 43f64.to_radians().cos();
        let wanted = knife_edge(h_m * (2.0 / (L1_M * d_m)).sqrt());
        assert!((below.loss_db() + 20.0 * wanted.norm().log10()).abs() < 0.1, "{below:?}");
        assert!((below.late_cycles() + wanted.arg() / core::f64::consts::TAU).abs() < 0.01);
        assert!(received(&wall(0.0), 0.0, 80.0).loss_db().abs() < 0.6);
        assert!(received(&wall(0.0), 0.0, 20.0).loss_db() > 25.0);
    }

    /// Beside the wall the sky is open; at its upright edge half of the field is left.
    #[test]
    fn satellites_set_behind_the_side() {
        let edge_deg = 100f64.atan2(10.0).to_degrees();
        assert!((received(&wall(0.0), edge_deg, 1.0).loss_db() - 6.02).abs() < 0.5);
        assert!(received(&wall(0.0), edge_deg + 4.0, 1.0).loss_db().abs() < 1.0);
        assert_eq!(received(&wall(0.0), 180.0, 20.0).loss_db(), 0.0);
    }

    /// A satellite in the south at 30° comes back from the wall 2 · 10 m · cos 30° later, one at 60°
    /// over it does not.
    #[test]
    fn echoes_come_from_the_other_side() {
        let effect = wall(0.5).effect(&Vector3::zeros(), &sight(180.0, 30.0)).unwrap();
        let WallEffect::Echo { delay_m, .. } = effect else { panic!("{effect:?}") };
        assert!((delay_m - 20.0 * 30f64.to_radians().cos()).abs() < 1e-9, "{delay_m}");
        let mut with = field(&[effect], L1_M);
        with.add_delayed(Complex::new(-0.5, 0.0), delay_m, L1_M);
        assert!(with.loss_db().abs() < 0.4, "the echo is half the field: {with:?}");
        assert!(received(&wall(0.5), 180.0, 60.0).loss_db().abs() < 1.0);
    }
}
