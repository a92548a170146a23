//! Records of 2020-06-25, received by station MOJN, for the tests of this module.

use super::glonass::GlonassElements;
use super::kepler::{KeplerElements, Message};
use crate::frames::Vector;
use crate::signal::{Satellite, System};
use crate::time::GpsTime;

/// G15, tₒₑ 04:00:00 (week 2111, 360000 s).
pub(super) fn gps() -> KeplerElements {
    let reference_time = GpsTime::from_week_tow(2111, 360_000.0).unwrap();
    KeplerElements {
        satellite: Satellite::new(System::Gps, 15),
        message: Message::Lnav,
        reference_time,
        clock_reference_time: reference_time,
        transmission_time: GpsTime::from_week_tow(2111, 352_818.0).unwrap(),
        issue: 88,
        clock_bias_s: -2.219_416_201_115e-4,
        clock_drift: 2.614_797_267_597e-12,
        clock_drift_rate: 0.0,
        sqrt_axis: 5.153_706_258_774e3,
        eccentricity: 1.236_872_794_107e-2,
        mean_anomaly_rad: 1.932_456_693_161,
        mean_motion_correction_radps: 5.422_368_720_565e-9,
        perigee_rad: 8.856_049_299_601e-1,
        node_rad: -1.729_840_202_902,
        node_rate_radps: -8.295_345_534_438e-9,
        inclination_rad: 9.279_236_419_157e-1,
        inclination_rate_radps: 5.157_357_681_791e-10,
        latitude_harmonics_rad: [-1.508_742_570_877e-7, 9.519_979_357_719e-6],
        radius_harmonics_m: [1.816_562_5e2, -1.656_25],
        inclination_harmonics_rad: [-3.073_364_496_231e-7, -2.346_932_888_031e-7],
        group_delays_s: [-1.071_020_960_808e-8, 0.0],
        health: 0,
        accuracy_m: 2.0,
        fit_interval_s: Some(14_400.0),
    }
}

/// C05, geostationary, tₒₑ 01:00:00 BDT (BeiDou week 755, 349200 s).
pub(super) fn beidou_geo() -> KeplerElements {
    let reference_time = GpsTime::from_beidou_week_tow(755, 349_200.0).unwrap();
    KeplerElements {
        satellite: Satellite::new(System::BeiDou, 5),
        message: Message::BeiDouD2,
        reference_time,
        clock_reference_time: reference_time,
        transmission_time: reference_time + 27.6,
        issue: 1,
        clock_bias_s: -5.161_854_205_653e-4,
        clock_drift: -6.704_770_072_474e-11,
        clock_drift_rate: 0.0,
        sqrt_axis: 6.493_354_141_235e3,
        eccentricity: 3.731_949_254_87e-4,
        mean_anomaly_rad: -3.217_802_993_496e-1,
        mean_motion_correction_radps: -8.828_939_189_327e-10,
        perigee_rad: -1.631_268_101_001,
        node_rad: -2.974_700_793_988,
        node_rate_radps: 1.955_081_436_989e-9,
        inclination_rad: 1.082_992_475_555e-1,
        inclination_rate_radps: 5.096_640_866_978e-10,
        latitude_harmonics_rad: [-1.811_934_635_043e-5, 6.132_759_153_843e-6],
        radius_harmonics_m: [-1.850_625e2, -5.448_906_25e2],
        inclination_harmonics_rad: [1.396_983_861_923e-9, 6.891_787_052_155e-8],
        group_delays_s: [1e-10, -9.3e-9],
        health: 0,
        accuracy_m: 2.0,
        fit_interval_s: None,
    }
}

/// E12, I/NAV, tₒₑ 02:50:00 (week 2111, 355800 s).
pub(super) fn galileo() -> KeplerElements {
    let reference_time = GpsTime::from_week_tow(2111, 355_800.0).unwrap();
    KeplerElements {
        satellite: Satellite::new(System::Galileo, 12),
        message: Message::GalileoInav,
        reference_time,
        clock_reference_time: reference_time,
        transmission_time: reference_time + 1235.0,
        issue: 81,
        clock_bias_s: 5.738_438_514_527e-3,
        clock_drift: -1.884_359_335_236e-11,
        clock_drift_rate: 0.0,
        sqrt_axis: 5.440_605_503_082e3,
        eccentricity: 3.694_026_963_785e-4,
        mean_anomaly_rad: 4.954_544_388_089e-2,
        mean_motion_correction_radps: 2.895_477_751_128e-9,
        perigee_rad: 2.563_638_737_386e-1,
        node_rad: 2.295_360_174_165,
        node_rate_radps: -5.910_960_500_945e-9,
        inclination_rad: 9.883_732_807_087e-1,
        inclination_rate_radps: 1.871_506_527_187e-10,
        latitude_harmonics_rad: [1.104_548_573_494e-6, -4.675_239_324_57e-7],
        radius_harmonics_m: [3.639_062_5e2, 2.353_125e1],
        inclination_harmonics_rad: [-5.774_199_962_616e-8, 3.725_290_298_462e-9],
        group_delays_s: [-1.303_851_604_462e-8, -1.280_568_540_096e-8],
        health: 0,
        accuracy_m: 3.12,
        fit_interval_s: None,
    }
}

/// R05, 04:45 UTC.
pub(super) fn glonass() -> GlonassElements {
    let reference_time = GpsTime::from_week_tow(2111, 362_718.0).unwrap();
    GlonassElements {
        satellite: Satellite::new(System::Glonass, 5),
        reference_time,
        transmission_time: reference_time,
        clock_bias_s: 5.293_264_985_085e-5,
        clock_drift: 9.094_947_017_729e-13,
        position_m: Vector::new(-6_018_835.449_219, -9_376_655.761_719, 22_961_872.070_31),
        velocity_mps: Vector::new(2_992.804_527_283, -952.021_598_815_9, 394.248_962_402_3),
        acceleration_mps2: Vector::new(
            -9.313_225_746_155e-7,
            1.862_645_149_231e-6,
            -1.862_645_149_231e-6,
        ),
        channel: 1,
        l2_delay_s: None,
        health: 0,
        accuracy_m: 5.0,
    }
}
