//! `report.html` of `kurs calibrate`: residuals of every pose, or the Allan deviation.

use std::path::Path;

use kurs::calibration::allan::AllanPoint;
use kurs::calibration::sensor_model::{Pose, SensorModel};
use plotly::common::{ErrorData, ErrorType, Mode, Title};
use plotly::layout::{Axis, AxisType, Layout};
use plotly::{Plot, Scatter};

use crate::page::Page;

const AXES: [&str; 3] = ["x", "y", "z"];

/// Length residuals with the noise of the pose means, and the model with its standard deviations.
pub(super) fn accelerometer(
    out: &Path,
    poses: &[Pose],
    model: &SensorModel,
    residuals_mps2: &[f64],
) -> anyhow::Result<()> {
    let mut page = Page::new("Accelerometer calibration");
    page.paragraph("Reading = matrix × truth + bias; each value with its standard deviation.");
    let header = ["reading", "matrix, x", "matrix, y", "matrix, z", "bias, m/s²"];
    let rows: Vec<Vec<String>> = (0..3)
        .map(|row| {
            let mut cells = vec![AXES[row].to_owned()];
            cells.extend((0..3).map(|column| {
                let (value, sd) = (model.matrix[(row, column)], model.matrix_sd[(row, column)]);
                format!("{value:.6} ± {sd:.6}")
            }));
            cells.push(format!("{:.5} ± {:.5}", model.bias_mps2[row], model.bias_sd_mps2[row]));
            cells
        })
        .collect();
    page.table(&header, &rows);
    page.heading("Residuals");
    page.paragraph(
        "Length of the corrected reading less gravity, for each pose; the bars are the noise of its \
         mean. One pose far off: motion in it. All off with a pattern: poses not as assumed, or a \
         saturated axis.",
    );
    let noise = poses.iter().map(Pose::mean_sd_mps2).collect();
    let mut plot = Plot::new();
    plot.add_trace(
        Scatter::new((1..=poses.len()).collect(), residuals_mps2.to_vec())
            .mode(Mode::Markers)
            .error_y(ErrorData::new(ErrorType::Data).array(noise)),
    );
    plot.set_layout(
        Layout::new()
            .x_axis(Axis::new().title(Title::with_text("pose")))
            .y_axis(Axis::new().title(Title::with_text("residual, m/s²"))),
    );
    page.plot(&plot);
    page.write(out, "report.html")
}

/// Allan deviation of the three axes.
pub(super) fn gyro(out: &Path, curves: &[Vec<AllanPoint>]) -> anyhow::Result<()> {
    let mut page = Page::new("Gyro calibration");
    page.heading("Allan deviation");
    page.paragraph(
        "White noise falls with the square root of the averaging time; where the curve is lowest \
         stands the bias instability.",
    );
    let mut plot = Plot::new();
    for (curve, name) in curves.iter().zip(AXES) {
        let tau_s = curve.iter().map(|point| point.tau_s).collect();
        let per_hour = 1f64.to_degrees() * 3600.0;
        let deviation = curve.iter().map(|point| point.deviation * per_hour).collect();
        plot.add_trace(Scatter::new(tau_s, deviation).mode(Mode::LinesMarkers).name(name));
    }
    let logarithmic = |title: &str| Axis::new().type_(AxisType::Log).title(Title::with_text(title));
    plot.set_layout(
        Layout::new()
            .x_axis(logarithmic("averaging time, s"))
            .y_axis(logarithmic("Allan deviation, °/h")),
    );
    page.plot(&plot);
    page.write(out, "report.html")
}
