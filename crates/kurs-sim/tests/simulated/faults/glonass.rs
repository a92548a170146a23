//! GLONASS alone: every satellite has a wavelength of its own.

use kurs_sim::scenario::Bias;

use super::scene::{Outcome, Scene};

/// Share of right fixes, and the number of wrong ones, with a phase bias of antenna A1 for each step
/// of the frequency channel.
fn fixed(cycles_per_channel: f64, channel_sd_m: f64) -> (f64, usize) {
    let mut scene = Scene::new(3, |scenario| {
        scenario.interval_s = 0.5;
        scenario.signals = ["R1C", "R2C"].map(str::to_owned).to_vec();
        scenario.sky.systems = vec!["R".to_owned()];
        scenario.bias.push(Bias {
            antenna: "A1".to_owned(),
            phase_cycles_per_channel: cycles_per_channel,
            ..Bias::default()
        });
    });
    scene.settings.noise.channel_sd_m = channel_sd_m;
    let (mut rows, mut right, mut wrong) = (0, 0, 0);
    scene.run(
        |_, epoch| vec![epoch],
        |_, _, outcome| {
            rows += 1;
            right += usize::from(outcome == Outcome::Right);
            wrong += usize::from(outcome == Outcome::Wrong);
        },
    );
    let share = f64::from(rows).recip() * right as f64;
    println!(
        "{cycles_per_channel} cycles a channel, {channel_sd_m} m: right {share}, wrong {wrong}"
    );
    (share, wrong)
}

#[test]
fn like_receivers() {
    let (share, wrong) = fixed(0.0, 0.0);
    assert_eq!(wrong, 0);
    assert!(share >= 0.99, "{share}");
}

/// 0.15 cycles (28 mm) a channel: told so or not, nothing wrong is called fixed.
#[test]
fn mixed_receivers() {
    for channel_sd_m in [0.0, 0.05] {
        let (_, wrong) = fixed(0.15, channel_sd_m);
        assert_eq!(wrong, 0, "{channel_sd_m}");
    }
}
