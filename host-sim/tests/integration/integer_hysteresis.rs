//! The integer hysteresis of the controller against the f64 model of the plant: forward, inverse, limits,
//! full stack.

use hysteron_core::one_sided_hysteresis::{
    OneSidedHysteresis, STACK_CAPACITY, SURFACE_SIZE, SurfaceCoefficients, surface_fraction_bits,
};
use hysteron_sim::bench::Bench;
use hysteron_sim::hysteresis_surface::{OneSidedHysteresis as FloatHysteresis, Surfaces};
use proptest::prelude::*;

const ONE: f64 = (1u64 << 30) as f64;
const UM: f64 = (1u64 << 24) as f64;

fn surfaces() -> Surfaces {
    let bench = Bench::reference().unwrap();
    Surfaces::from_thesis_powers(&bench.hysteresis.f, &bench.hysteresis.g, 80.0)
}

fn quantised(surfaces: &Surfaces) -> SurfaceCoefficients {
    let quantise = |v: f64, i: usize, j: usize| {
        (v * f64::from(1u32 << surface_fraction_bits(i, j))).round() as i32
    };
    let mut out = SurfaceCoefficients {
        g: [[0; SURFACE_SIZE]; SURFACE_SIZE],
        f: [0; SURFACE_SIZE],
    };
    for i in 0..SURFACE_SIZE {
        for j in 0..SURFACE_SIZE {
            out.g[i][j] = quantise(surfaces.g[i][j], i, j);
        }
        out.f[i] = quantise(surfaces.g[i][0] + surfaces.r[i], i, 0);
    }
    out
}

fn integer(surfaces: &Surfaces) -> OneSidedHysteresis {
    OneSidedHysteresis::virgin(quantised(surfaces))
}

fn share(x: f64) -> i32 {
    (x * ONE).round() as i32
}

/// Histories whose reversals the controller's stack can hold.
fn history() -> impl Strategy<Value = Vec<f64>> {
    proptest::collection::vec(0.0f64..=1.0, 1..STACK_CAPACITY)
}

proptest! {
    #[test]
    fn forward_is_the_plant_model(drive in history()) {
        let mut reference = FloatHysteresis::virgin(surfaces(), 0.0, 80.0);
        let mut ours = integer(&surfaces());
        for x in drive {
            let exact = reference.step(x * 80.0);
            let found = f64::from(ours.apply(share(x))) / UM;
            prop_assert!((exact - found).abs() < 2e-5, "{exact} {found}");
        }
    }

    #[test]
    fn inverse_finds_the_drive(drive in history(), wanted in 0.0f64..=1.0) {
        let mut ours = integer(&surfaces());
        for x in drive {
            ours.apply(share(x));
        }
        // The output that another drive would give from here is reachable, and any share that gives it is
        // right.
        let mut probe = ours.clone();
        let target = probe.apply(share(wanted));
        let inverse = ours.inverse(target);
        prop_assert!(inverse.reachable);
        let mut check = ours.clone();
        let got = check.apply(inverse.share);
        let jump = (wanted - f64::from(ours.share()) / ONE).abs();
        // Any jump to a few nanometres in one tick; the jumps that a 500 Hz reference makes to a hundredth of
        // one.
        let tolerance_um = if jump < 0.1 { 1e-5 } else { 0.01 };
        prop_assert!((f64::from(got - target) / UM).abs() < tolerance_um, "{} um, jump {jump}", f64::from(got - target) / UM);
    }

    #[test]
    fn inverse_is_monotone(drive in history(), a in -1.0f64..13.0, b in -1.0f64..13.0) {
        let mut ours = integer(&surfaces());
        for x in drive {
            ours.apply(share(x));
        }
        let (low, high) = (a.min(b), a.max(b));
        // Newton's last step leaves at most this.
        let slack = share(1e-3);
        prop_assert!(ours.inverse((low * UM) as i32).share <= ours.inverse((high * UM) as i32).share + slack);
    }

    #[test]
    fn outside_the_range_it_saturates_and_says_so(drive in history()) {
        let mut ours = integer(&surfaces());
        for x in drive {
            ours.apply(share(x));
        }
        let above = ours.inverse((12.9 * UM) as i32);
        prop_assert!(!above.reachable);
        prop_assert!(above.share > share(0.99));
        // What zero drive gives from here: everything below is out of reach (thesis Ch. 4, the remnant).
        let mut probe = ours.clone();
        let least = probe.apply(0);
        if ours.share() > 0 {
            let below = ours.inverse(least - (0.05 * UM) as i32);
            prop_assert!(!below.reachable);
            prop_assert!(below.share < share(0.01));
        }
    }

    #[test]
    fn a_full_stack_errs_by_no_more_than_its_bound(amplitudes in proptest::collection::vec(0.001f64..0.02, 60)) {
        let mut reference = FloatHysteresis::virgin(surfaces(), 0.0, 80.0);
        let mut ours = integer(&surfaces());
        // Shrinking loops around mid-range, more than the stack holds.
        let (mut low, mut high) = (0.05, 0.95);
        let mut drive = vec![0.0];
        for pair in amplitudes.chunks_exact(2) {
            drive.extend([high, low]);
            high -= pair[0].min(0.4 * (high - low));
            low += pair[1].min(0.4 * (high - low));
        }
        drive.extend((0..=50).map(|k| low + (0.97 - low) * f64::from(k) / 50.0));
        let model = surfaces();
        let mut curvature = 0.0f64;
        let at = |k: i32| f64::from(k) / 40.0;
        for i in 1..40 {
            for j in 0..i {
                let mixed = model.loop_loss(at(i), at(j)) - model.loop_loss(at(i - 1), at(j)) - model.loop_loss(at(i), at(j + 1)) + model.loop_loss(at(i - 1), at(j + 1));
                curvature = curvature.max(mixed.abs() * 1600.0);
            }
        }
        for x in drive {
            let exact = reference.step(x * 80.0);
            let found = f64::from(ours.apply(share(x))) / UM;
            let height = f64::from(ours.largest_dropped_loop()) / ONE;
            let bound = f64::from(ours.dropped_loops()) * curvature * height * height + 5e-5;
            prop_assert!((exact - found).abs() <= bound, "{exact} {found}, {} loops dropped, height {height}, bound {bound}", ours.dropped_loops());
        }
    }
}

#[test]
fn memory_survives_a_change_of_surfaces() {
    let mut ours = integer(&surfaces());
    for x in [0.8, 0.2, 0.6, 0.3, 0.5, 0.45] {
        ours.apply(share(x));
    }
    let again = ours.with_surfaces(quantised(&surfaces()));
    assert_eq!(again.output(), ours.output());
    assert_eq!(again.stored_pairs(), ours.stored_pairs());
}
