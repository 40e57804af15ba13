//! The numbers of a scenario: their names, what each accepts, and what it sets.
//!
//! Every one of them may have a spread. Units are in the names; what is not said is as in
//! [`BenchSetup::default`]: ideal.

use crate::campaign::setup::BenchSetup;
use crate::model::arm_model::ELEMENTS_MAX;
use crate::plant::SUBSTEPS_MAX;
use crate::plant::bench::DELAY_TICKS_MAX;

/// A number of a scenario.
#[derive(Debug)]
pub struct Key {
    /// Section and name, with a dot between them.
    pub name: &'static str,
    /// Smallest value that it accepts; itself excluded where `above`.
    pub low: f64,
    /// Whether only more than `low` is accepted.
    pub above: bool,
    /// Largest value.
    pub high: f64,
    /// Words for what it is, with its unit.
    pub what: &'static str,
    /// Whether only whole numbers are accepted.
    pub whole: bool,
    set: fn(&mut BenchSetup, f64),
}

impl Key {
    /// Sets it.
    pub fn set(&self, setup: &mut BenchSetup, value: f64) {
        (self.set)(setup, value);
    }

    /// The key of this name.
    pub fn find(name: &str) -> Option<&'static Self> {
        KEYS.iter().copied().flatten().find(|key| key.name == name)
    }

    /// True for values that it accepts; false for NaN.
    pub fn holds(&self, value: f64) -> bool {
        let low = if self.above {
            value > self.low
        } else {
            value >= self.low
        };
        low && value <= self.high && (!self.whole || value.fract() == 0.0)
    }
}

type Set = fn(&mut BenchSetup, f64);

/// From `low` to `high`.
const fn from(name: &'static str, low: f64, high: f64, what: &'static str, set: Set) -> Key {
    Key {
        name,
        low,
        above: false,
        high,
        what,
        whole: false,
        set,
    }
}

/// Above `low`, up to `high`.
const fn above(name: &'static str, low: f64, high: f64, what: &'static str, set: Set) -> Key {
    Key {
        above: true,
        ..from(name, low, high, what, set)
    }
}

/// A whole number from `low` to `high`.
const fn whole(name: &'static str, low: f64, high: f64, what: &'static str, set: Set) -> Key {
    Key {
        whole: true,
        ..from(name, low, high, what, set)
    }
}

const TICKS: &str = "a whole number of ticks";
const DELAY: f64 = DELAY_TICKS_MAX as f64;

/// Those of a joint and its drive, which there are two of.
macro_rules! of_joint {
    ($joint:literal, $drive:literal, $i:literal) => {
        [
            from(
                concat!($joint, ".coulomb_Nm"),
                0.0,
                1e4,
                "a torque in N m",
                |s, x| {
                    s.plant.coulomb_friction_nm[$i] = x;
                },
            ),
            from(
                concat!($joint, ".breakaway_Nm"),
                0.0,
                1e4,
                "a torque in N m",
                |s, x| {
                    s.compliant.joints[$i].friction.breakaway_nm = x;
                },
            ),
            above(
                concat!($joint, ".stribeck_rad_s"),
                0.0,
                1e3,
                "a rate in rad/s",
                |s, x| {
                    s.compliant.joints[$i].friction.stribeck_rad_s = x;
                },
            ),
            from(
                concat!($joint, ".viscous_Nms_rad"),
                0.0,
                1e4,
                "a friction in N m s/rad",
                |s, x| {
                    s.plant.viscous_friction_nms_rad[$i] = x;
                },
            ),
            from(
                concat!($joint, ".pre_sliding_rad"),
                1e-6,
                1.0,
                "an angle in rad",
                |s, x| {
                    s.compliant.joints[$i].friction.pre_sliding_rad = x;
                },
            ),
            from(
                concat!($joint, ".cogging_Nm"),
                0.0,
                1e4,
                "a torque in N m",
                |s, x| {
                    s.compliant.joints[$i].cogging.amplitude_nm = x;
                },
            ),
            from(
                concat!($joint, ".cogging_periods"),
                0.0,
                1e4,
                "a number of periods a turn",
                |s, x| {
                    s.compliant.joints[$i].cogging.periods = x;
                },
            ),
            from(
                concat!($joint, ".cogging_phase_rad"),
                -7.0,
                7.0,
                "an angle in rad",
                |s, x| {
                    s.compliant.joints[$i].cogging.phase_rad = x;
                },
            ),
            from(
                concat!($joint, ".rotor_inertia_kgm2"),
                0.0,
                1e3,
                "an inertia in kg m^2",
                |s, x| {
                    s.compliant.joints[$i].rotor_inertia_kgm2 = x;
                },
            ),
            from(
                concat!($joint, ".gear_ratio"),
                1e-2,
                1e4,
                "rotor turns a joint turn",
                |s, x| {
                    s.compliant.joints[$i].gear_ratio = x;
                },
            ),
            from(
                concat!($joint, ".play_rad"),
                0.0,
                1.0,
                "an angle in rad",
                |s, x| {
                    s.gear_play[$i].play_rad = x;
                },
            ),
            above(
                concat!($joint, ".play_stiffness_Nm_rad"),
                0.0,
                1e9,
                "a stiffness in N m/rad",
                |s, x| {
                    s.gear_play[$i].stiffness_nm_rad = x;
                },
            ),
            from(
                concat!($joint, ".play_damping_Nms_rad"),
                0.0,
                1e6,
                "a damping in N m s/rad",
                |s, x| {
                    s.gear_play[$i].damping_nms_rad = x;
                },
            ),
            above(
                concat!($drive, ".bandwidth_Hz"),
                0.0,
                1e6,
                "a frequency in Hz",
                |s, x| {
                    s.compliant.drives[$i].bandwidth_hz = Some(x);
                },
            ),
            whole(
                concat!($drive, ".delay_ticks"),
                0.0,
                DELAY,
                TICKS,
                |s, x| {
                    s.compliant.drives[$i].delay_ticks = x as usize;
                },
            ),
            from(
                concat!($drive, ".gain"),
                -10.0,
                10.0,
                "torque given over torque asked for",
                |s, x| {
                    s.compliant.drives[$i].gain = x;
                },
            ),
            from(
                concat!($drive, ".offset_Nm"),
                -1e4,
                1e4,
                "a torque in N m",
                |s, x| {
                    s.compliant.drives[$i].offset_nm = x;
                },
            ),
            from(
                concat!($drive, ".noise_Nm"),
                0.0,
                1e4,
                "a torque in N m rms",
                |s, x| {
                    s.compliant.drives[$i].noise_nm = x;
                },
            ),
            above(
                concat!($drive, ".limit_Nm"),
                0.0,
                1e6,
                "a torque in N m",
                |s, x| {
                    s.compliant.drives[$i].limit_nm = x;
                },
            ),
        ]
    };
}

/// Those of an analog sensor, whose unit is `$unit`.
macro_rules! of_sensor {
    ($sensor:literal, $field:ident, $offset:literal, $drift:literal, $noise:literal,
     $saturation:literal, $unit:literal) => {
        [
            from(
                concat!($sensor, ".gain_error"),
                -2.0,
                10.0,
                "measured over true, less 1",
                |s, x| {
                    s.sensors.$field.gain = x;
                },
            ),
            from(
                concat!($sensor, $offset),
                -1e4,
                1e4,
                concat!("an offset in ", $unit),
                |s, x| {
                    s.sensors.$field.offset = x;
                },
            ),
            from(
                concat!($sensor, $drift),
                -1e4,
                1e4,
                concat!("a drift in ", $unit, "/s"),
                |s, x| {
                    s.sensors.$field.drift_per_s = x;
                },
            ),
            from(
                concat!($sensor, $noise),
                0.0,
                1e4,
                concat!("a noise in ", $unit, " rms"),
                |s, x| {
                    s.sensors.$field.noise = x;
                },
            ),
            above(
                concat!($sensor, $saturation),
                0.0,
                1e6,
                concat!("a range in ", $unit),
                |s, x| {
                    s.sensors.$field.saturation = x;
                },
            ),
            whole(
                concat!($sensor, ".delay_ticks"),
                0.0,
                DELAY,
                TICKS,
                |s, x| {
                    s.sensors.$field.delay_ticks = x as usize;
                },
            ),
        ]
    };
}

const ARM: [Key; 11] = [
    whole(
        "plant.elements",
        1.0,
        ELEMENTS_MAX as f64,
        "a whole number of elements",
        |s, x| {
            s.plant.elements = x as usize;
        },
    ),
    from("plant.link1_mass_scale", 0.01, 100.0, "a factor", |s, x| {
        s.plant.link1_mass_scale = x;
    }),
    from("plant.link2_mass_scale", 0.01, 100.0, "a factor", |s, x| {
        s.plant.link2_mass_scale = x;
    }),
    from(
        "plant.link1_length_offset_m",
        -10.0,
        10.0,
        "a length in m",
        |s, x| {
            s.link1_length_offset_m = x;
        },
    ),
    from(
        "plant.link2_length_offset_m",
        -10.0,
        10.0,
        "a length in m",
        |s, x| {
            s.link2_length_offset_m = x;
        },
    ),
    from(
        "plant.bending_stiffness_scale",
        0.01,
        100.0,
        "a factor",
        |s, x| {
            s.plant.bending_stiffness_scale = x;
        },
    ),
    from("plant.damping_scale", 0.0, 10.0, "a factor", |s, x| {
        s.plant.damping_scale = x;
    }),
    from(
        "plant.root_inertia_kgm2",
        0.0,
        1e3,
        "an inertia in kg m^2",
        |s, x| {
            s.plant.root_inertia_kgm2 = Some(x);
        },
    ),
    from("plant.tip_mass_kg", 0.0, 1e5, "a mass in kg", |s, x| {
        s.plant.tip_mass_kg = Some(x);
    }),
    from(
        "plant.tip_inertia_kgm2",
        0.0,
        1e3,
        "an inertia in kg m^2",
        |s, x| {
            s.plant.tip_inertia_kgm2 = Some(x);
        },
    ),
    whole(
        "plant.substeps",
        1.0,
        SUBSTEPS_MAX as f64,
        "a whole number of integration steps a tick",
        |s, x| {
            s.plant.substeps = Some(x as u32);
        },
    ),
];

const SURFACE: [Key; 12] = [
    from("surface.deeper_m", -10.0, 10.0, "a length in m", |s, x| {
        s.compliant.surface.raise_m = x;
    }),
    from("surface.tilt_rad", -1.0, 1.0, "an angle in rad", |s, x| {
        s.compliant.surface.slope = libm::tan(x);
    }),
    from(
        "surface.tilt_about_m",
        -200.0,
        200.0,
        "a place along the surface in m",
        |s, x| {
            s.tilt_about_m = Some(x);
        },
    ),
    from("surface.waviness_m", 0.0, 1.0, "a length in m", |s, x| {
        s.compliant.surface.waviness_m = x;
    }),
    above(
        "surface.wavelength_m",
        0.0,
        100.0,
        "a length in m",
        |s, x| {
            s.compliant.surface.wavelength_m = x;
        },
    ),
    from("surface.phase_rad", -7.0, 7.0, "an angle in rad", |s, x| {
        s.compliant.surface.phase_rad = x;
    }),
    above(
        "contact.stiffness_N_m",
        0.0,
        1e8,
        "a stiffness in N/m",
        |s, x| {
            s.compliant.contact.stiffness_n_m = x;
        },
    ),
    from(
        "contact.damping_Ns_m",
        0.0,
        1e6,
        "a damping in N s/m",
        |s, x| {
            s.compliant.contact.damping_ns_m = x;
        },
    ),
    from("contact.friction", 0.0, 10.0, "a coefficient", |s, x| {
        s.compliant.contact.friction = x;
    }),
    from(
        "contact.friction_at_rest",
        0.0,
        10.0,
        "a coefficient",
        |s, x| {
            s.compliant.contact.friction_at_rest = x;
        },
    ),
    above(
        "contact.stribeck_speed_m_s",
        0.0,
        100.0,
        "a speed in m/s",
        |s, x| {
            s.compliant.contact.stribeck_speed_m_s = x;
        },
    ),
    above(
        "contact.bristle_stiffness_N_m",
        0.0,
        1e8,
        "a stiffness in N/m",
        |s, x| {
            s.compliant.contact.bristle_stiffness_n_m = x;
        },
    ),
];

const ENCODERS: [Key; 4] = [
    whole("encoders.delay_ticks", 0.0, DELAY, TICKS, |s, x| {
        s.sensors.encoder_delay_ticks = x as usize;
    }),
    from(
        "encoders.homing1_rad",
        -4.0,
        4.0,
        "an angle in rad",
        |s, x| {
            s.sensors.homing_rad[0] = x;
        },
    ),
    from(
        "encoders.homing2_rad",
        -4.0,
        4.0,
        "an angle in rad",
        |s, x| {
            s.sensors.homing_rad[1] = x;
        },
    ),
    from(
        "converter.dropout",
        0.0,
        1.0,
        "a probability a tick",
        |s, x| {
            s.sensors.dropout = x;
        },
    ),
];

const JOINT1: [Key; 19] = of_joint!("joint1", "drive1", 0);
const JOINT2: [Key; 19] = of_joint!("joint2", "drive2", 1);
const FORCE_CELL: [Key; 6] = of_sensor!(
    "force_cell",
    cell,
    ".offset_N",
    ".drift_N_s",
    ".noise_N",
    ".saturation_N",
    "N"
);
const ROOT_GAUGE: [Key; 6] = of_sensor!(
    "root_gauge",
    gauge,
    ".offset_rad",
    ".drift_rad_s",
    ".noise_rad",
    ".saturation_rad",
    "rad"
);

const COURSE: [Key; 2] = [
    from("course.gap_m", 0.0, 1.0, "a distance in m", |s, x| {
        s.course.gap_m = Some(x);
    }),
    from("course.after_s", 0.0, 60.0, "a time in s", |s, x| {
        s.course.after_s = x;
    }),
];

/// All of them, section by section.
pub const KEYS: &[&[Key]] = &[
    &ARM,
    &JOINT1,
    &JOINT2,
    &SURFACE,
    &ENCODERS,
    &FORCE_CELL,
    &ROOT_GAUGE,
    &COURSE,
];
