//! Whether accelerometers are in the unit that the header says: their size must be that of gravity.

use anyhow::bail;

/// Samples that are looked at.
pub(super) const SAMPLES: usize = 2000;
/// What a resting accelerometer reads.
pub(crate) const AT_REST_MPS2: f64 = 9.81;

/// Refuses accelerometers whose median size is far from the expected one, with the likely unit.
pub(crate) fn refuse_other_units(
    mut norms_mps2: Vec<f64>,
    expected_mps2: f64,
) -> anyhow::Result<()> {
    norms_mps2.sort_by(f64::total_cmp);
    let Some(found) = norms_mps2.get(norms_mps2.len() / 2) else {
        bail!("no accelerometer sample")
    };
    if (0.3..3.0).contains(&(found / expected_mps2)) {
        return Ok(());
    }
    let likely = [("g", 9.806_65), ("mg", 9.806_65e-3), ("cm/s²", 0.01)];
    let unit = likely.iter().find(|(_, one)| (0.5..2.0).contains(&(found * one / expected_mps2)));
    let hint = unit.map_or("is the unit in the header right?".to_owned(), |(unit, _)| {
        format!("the unit is probably {unit}, name it in the header")
    });
    bail!(
        "accelerometers read {found:.2} m/s² in the middle, gravity and the arm make about \
         {expected_mps2:.2} m/s²: {hint}"
    );
}
