//! The finite-element beam against independent figures.

use flexor::model::{Beam, BeamParameters};

/// The numbers of a section of the reference file, row by row.
fn section(name: &str) -> Vec<f64> {
    let text = std::fs::read_to_string(flexor_tests::path("fem_3_elements.txt")).unwrap();
    let mut lines = text
        .lines()
        .skip_while(|line| *line != name)
        .skip(1)
        .peekable();
    assert!(lines.peek().is_some(), "no section {name}");
    lines
        .map_while(|line| {
            let numbers = line.split_whitespace().map(|x| x.parse().ok());
            numbers.collect::<Option<Vec<f64>>>()
        })
        .flatten()
        .collect()
}

fn table_1() -> Beam<f64, 6> {
    Beam::new(BeamParameters {
        length: 0.55,
        mass: 0.24,
        bending_stiffness: 0.48,
        root_inertia: 0.0,
        tip_mass: 0.0,
        tip_inertia: 0.0,
    })
}

fn assert_equal(name: &str, found: &[f64], relative: f64) {
    let expected = section(name);
    assert_eq!(found.len(), expected.len(), "{name}");
    let largest = expected.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    for (i, (a, b)) in found.iter().zip(&expected).enumerate() {
        // The reference has rounding residues where the entry is zero.
        let bound = relative * b.abs() + 1e-15 * largest;
        assert!((a - b).abs() <= bound, "{name}[{i}]: {a:e} is not {b:e}");
    }
}

#[test]
fn matrices_equal_the_reference_to_1e_9() {
    let beam = table_1();
    let modes = beam.modes().unwrap();
    assert_equal("M", beam.mass.as_slice(), 1e-9);
    assert_equal("K", beam.stiffness.as_slice(), 1e-9);
    assert_equal("D", beam.damping(&modes, 0.05).as_slice(), 1e-9);
    assert_equal("int_B_dm", beam.first_moment.as_slice(), 1e-9);
    assert_equal("int_rhoB_dm", beam.second_moment.as_slice(), 1e-9);
}

#[test]
fn frequencies_equal_the_reference_to_1e_6_hz() {
    let found = table_1().modes().unwrap().angular_frequency / core::f64::consts::TAU;
    let expected = section("frequencies_Hz");
    assert_eq!(expected.len(), 6);
    for (a, b) in found.iter().zip(expected) {
        assert!((a - b).abs() <= 1e-6, "{a} Hz is not {b} Hz");
    }
}

#[test]
fn f32_beams_are_the_same_beams() {
    let (double, single) = (
        table_1(),
        Beam::<f32, 6>::new(BeamParameters {
            length: 0.55,
            mass: 0.24,
            bending_stiffness: 0.48,
            root_inertia: 0.0,
            tip_mass: 0.0,
            tip_inertia: 0.0,
        }),
    );
    for (a, b) in double.stiffness.iter().zip(single.stiffness.iter()) {
        assert!((a - f64::from(*b)).abs() <= 1e-6 * double.stiffness.amax());
    }
    let frequency = |w: f64| w / core::f64::consts::TAU;
    let lowest = f64::from(single.modes().unwrap().angular_frequency[0]);
    assert!((frequency(lowest) - 5.450575).abs() < 1e-3);
}
