//! Statistics against published worked examples and against statsmodels, pingouin, SciPy and mpmath.

use carpus::statistics::*;
use serde_json::Value;

/// Largest difference from the references, absolute for values up to 1 and relative above.
const TOLERANCE: f64 = 1e-9;

fn reference() -> Value {
    serde_json::from_str(include_str!("../../fixtures/statistics/reference_statistics.json")).expect("valid JSON")
}

fn list(value: &Value) -> &[Value] {
    value.as_array().expect("a list")
}

fn number(value: &Value) -> f64 {
    value.as_f64().expect("a number")
}

fn numbers(value: &Value) -> Vec<f64> {
    list(value).iter().map(number).collect()
}

/// Collects residuals and fails on the first above the tolerance.
#[derive(Default)]
struct Residuals(f64);

impl Residuals {
    fn check(&mut self, what: &str, ours: f64, theirs: f64) {
        let residual = (ours - theirs).abs() / theirs.abs().max(1.0);
        assert!(residual < TOLERANCE, "{what}: ours {ours}, reference {theirs}");
        self.0 = self.0.max(residual);
    }
}

fn design(levels: &[usize], rows: &[Vec<f64>]) -> RepeatedMeasures {
    let factor = |(i, n): (usize, &usize)| Factor::new(format!("f{i}"), (0..*n).map(|level| level.to_string()));
    RepeatedMeasures::new(levels.iter().enumerate().map(factor).collect(), rows).expect("complete data")
}

fn anova_cases() -> Vec<(Value, Vec<Effect>)> {
    let reference = reference();
    let case = |case: &Value| {
        let levels: Vec<usize> = numbers(&case["levels"]).iter().map(|n| *n as usize).collect();
        let rows: Vec<Vec<f64>> = list(&case["values"]).iter().map(numbers).collect();
        (case.clone(), design(&levels, &rows).anova())
    };
    list(&reference["anova"]).iter().map(case).collect()
}

#[test]
fn val_statsmodels_repeated_measures_anova() {
    let mut residuals = Residuals::default();
    let mut effects = 0;
    for (case, ours) in anova_cases() {
        assert_eq!(ours.len(), list(&case["effects"]).len());
        for theirs in list(&case["effects"]) {
            let names: Vec<String> = numbers(&theirs["factors"]).iter().map(|f| format!("f{f}")).collect();
            let effect = ours.iter().find(|e| e.factors == names).expect("every effect");
            let what = format!("{} {}", case["levels"], effect.name());
            let mut check =
                |key: &str, ours: f64| residuals.check(&format!("{what} {key}"), ours, number(&theirs[key]));
            check("f", effect.f);
            check("p", effect.p_value);
            check("gg", effect.sphericity.greenhouse_geisser);
            check("hf", effect.sphericity.huynh_feldt);
            check("p_gg", effect.p_greenhouse_geisser);
            check("p_hf", effect.p_huynh_feldt);
            if theirs["w"].is_number() {
                check("w", effect.sphericity.mauchly_w.expect("testable"));
                check("chi2", effect.sphericity.chi_squared.expect("testable"));
                check("p_w", effect.sphericity.p_value.expect("testable"));
            } else {
                assert_eq!(effect.sphericity.mauchly_w, None, "{what}");
            }
            effects += 1;
        }
    }
    println!("{effects} effects, largest residual {:.1e}", residuals.0);
}

#[test]
fn val_pingouin_sphericity_and_effect_sizes() {
    let mut residuals = Residuals::default();
    for (case, ours) in anova_cases() {
        let theirs = &case["pingouin"];
        if theirs["w"].is_number() {
            let sphericity = ours[0].sphericity;
            residuals.check("f", ours[0].f, number(&theirs["f"]));
            residuals.check("gg", sphericity.greenhouse_geisser, number(&theirs["gg"]));
            residuals.check("hf", sphericity.huynh_feldt, number(&theirs["hf"]));
            residuals.check("np2", ours[0].partial_eta_squared, number(&theirs["np2"]));
            if let (Some(w), Some(chi), Some(p)) = (sphericity.mauchly_w, sphericity.chi_squared, sphericity.p_value) {
                residuals.check("w", w, number(&theirs["w"]));
                residuals.check("chi2", chi, number(&theirs["chi2"]));
                // R and pingouin take the number of conditions in one term of the second-order correction where
                // Anderson (2003) has the degrees of freedom; the p-values differ in the fourth digit.
                assert!((p - number(&theirs["p_w"])).abs() < 1e-3, "{p}");
            }
        } else if theirs["ss"].is_array() {
            for (i, effect) in ours.iter().enumerate() {
                residuals.check("ss", effect.sum_of_squares, number(&theirs["ss"][i]));
                residuals.check("f", effect.f, number(&theirs["f"][i]));
                residuals.check("ng2", effect.generalized_eta_squared, number(&theirs["ng2"][i]));
            }
        }
    }
    println!("largest residual {:.1e}", residuals.0);
}

/// Field (2013), Discovering Statistics Using IBM SPSS Statistics, 4th ed., chapter 14: time to retch of eight
/// celebrities for four dishes. The book prints SPSS's results with three decimals.
#[test]
fn val_published_one_way_repeated_measures() {
    let dishes = [
        [8.0, 9.0, 6.0, 5.0, 8.0, 7.0, 10.0, 12.0],
        [7.0, 5.0, 2.0, 3.0, 4.0, 5.0, 2.0, 6.0],
        [1.0, 2.0, 3.0, 1.0, 5.0, 6.0, 7.0, 8.0],
        [6.0, 5.0, 8.0, 9.0, 8.0, 7.0, 2.0, 1.0],
    ];
    let rows: Vec<Vec<f64>> = (0..8).map(|i| dishes.iter().map(|dish| dish[i]).collect()).collect();
    let effect = &design(&[4], &rows).anova()[0];
    let printed = |ours: f64, book: f64| assert!((ours - book).abs() < 6e-4, "ours {ours}, printed {book}");
    printed(effect.sum_of_squares, 83.125);
    printed(effect.error_sum_of_squares, 153.375);
    printed(effect.f, 3.794);
    printed(effect.p_value, 0.026);
    printed(effect.sphericity.mauchly_w.expect("testable"), 0.136);
    printed(effect.sphericity.chi_squared.expect("testable"), 11.406);
    printed(effect.sphericity.p_value.expect("testable"), 0.047);
    printed(effect.sphericity.greenhouse_geisser, 0.533);
    printed(effect.sphericity.huynh_feldt, 0.666);
    printed(effect.p_greenhouse_geisser, 0.063);
    printed(effect.p_huynh_feldt, 0.048);
    assert_eq!((effect.df_effect, effect.df_error), (3, 21));
}

/// Jadelis (2025), table 2.3: F(1, 9) and p of ten participants in a 2 × 2 design. One of the fifteen printed p-values
/// does not belong to its F (tendon slack length, interaction), and one of table 2.4 not to its test.
#[test]
fn val_published_dissertation_table_2_3() {
    let printed = [
        (5.403, 0.045),
        (0.743, 0.411),
        (6.620, 0.030),
        (21.284, 0.001),
        (2.278, 0.166),
        (1.030, 0.337),
        (0.022, 0.886),
        (1.560, 0.243),
        (0.198, 0.667),
        (0.258, 0.624),
        (7.122, 0.026),
        (2.128, 0.179),
        (9.534, 0.013),
    ];
    for (f, p) in printed {
        let ours = f_tail(f, 1.0, 9.0);
        assert!((ours - p).abs() < 1.5e-3, "F {f}: ours {ours:.4}, printed {p}");
    }
    assert!(f_tail(107.176, 1.0, 9.0) < 0.001);
    // Printed 0.667, which is the p-value of F = 0.198 two rows below.
    assert!((f_tail(0.069, 1.0, 9.0) - 0.799).abs() < 1e-3);
    // Table 2.4, effort on tendon slack length: 0.028 ± 0.019, printed p = 0.017*; the same test in table 2.3 has
    // 0.166.
    let from_mean_and_error = t_two_sided(0.028 / 0.019, 9.0);
    assert!((0.15..0.20).contains(&from_mean_and_error), "{from_mean_and_error}");
}

#[test]
fn val_scipy_paired_t_and_bonferroni() {
    let reference = reference();
    let rows: Vec<Vec<f64>> = list(&reference["anova"][1]["values"]).iter().map(numbers).collect();
    let names: Vec<String> = (0..5).map(|i| format!("muscle {i}")).collect();
    let ours = pairwise_comparisons(&names, &rows).expect("complete data");
    let mut residuals = Residuals::default();
    assert_eq!(ours.len(), list(&reference["paired"]).len());
    for (ours, theirs) in ours.iter().zip(list(&reference["paired"])) {
        let what = format!("{} and {}", ours.first, ours.second);
        residuals.check(&what, ours.test.t, number(&theirs["t"]));
        residuals.check(&what, ours.test.p_value, number(&theirs["p"]));
        residuals.check(&what, ours.p_bonferroni, number(&theirs["p_bonferroni"]));
        residuals.check(&what, ours.interval_95[0], number(&theirs["interval"][0]));
        residuals.check(&what, ours.interval_95[1], number(&theirs["interval"][1]));
        residuals.check(&what, ours.test.cohen_d_av, number(&theirs["d_av"]));
        residuals.check(&what, ours.test.cohen_d_z, ours.test.t / 10f64.sqrt());
    }
    println!("largest residual {:.1e}", residuals.0);
}

#[test]
fn verif_f_of_two_levels_is_t_squared() {
    let (case, effects) = anova_cases().into_iter().next().expect("2 × 2");
    let rows: Vec<Vec<f64>> = list(&case["values"]).iter().map(numbers).collect();
    let data = design(&[2, 2], &rows);
    for factor in 0..2 {
        let means = data.marginal_means(factor).expect("a factor");
        let column = |j: usize| means.iter().map(|row| row[j]).collect::<Vec<_>>();
        let t = paired_t_test(&column(0), &column(1)).expect("varies");
        assert!((t.t * t.t / effects[factor].f - 1.0).abs() < 1e-12);
        assert!((t.p_value / effects[factor].p_value - 1.0).abs() < 1e-10);
    }
    assert!(data.marginal_means(2).is_none());
}

#[test]
fn val_scipy_correlation_regression_agreement() {
    let mut residuals = Residuals::default();
    for case in list(&reference()["correlation"]) {
        let (x, y) = (numbers(&case["x"]), numbers(&case["y"]));
        let mut check = |key: &str, ours: &[f64]| {
            let theirs = if case[key].is_array() { numbers(&case[key]) } else { vec![number(&case[key])] };
            assert_eq!(ours.len(), theirs.len());
            ours.iter().zip(theirs).for_each(|(a, b)| residuals.check(key, *a, b));
        };
        let r = pearson(&x, &y).expect("varies");
        check("r", &[r.r]);
        check("p", &[r.p_value]);
        check("interval", &r.interval_95.expect("more than three"));
        let line = linear_regression(&x, &y).expect("varies");
        check("slope", &[line.slope]);
        check("intercept", &[line.intercept]);
        check("se", &[line.intercept_standard_error, line.slope_standard_error]);
        check("slope_interval", &line.slope_interval_95);
        check("r2", &[line.r_squared]);
        check("p_slope", &[line.p_value]);
        check("residual_sd", &[line.residual_sd]);
        let agreement = bland_altman(&x, &y, 0.95).expect("varies");
        check("bias", &[agreement.bias]);
        check("sd", &[agreement.sd]);
        check("limits", &agreement.limits);
        check("bias_interval", &agreement.bias_interval_95);
    }
    println!("largest residual {:.1e}", residuals.0);
}

/// Bland & Altman (1986), tables 1 and 2: peak flow of 17 people by two meters, first readings.
#[test]
fn val_published_bland_altman() {
    let wright = [494, 395, 516, 434, 476, 557, 413, 442, 650, 433, 417, 656, 267, 478, 178, 423, 427].map(f64::from);
    let mini = [512, 430, 520, 428, 500, 600, 364, 380, 658, 445, 432, 626, 260, 477, 259, 350, 451].map(f64::from);
    let agreement = bland_altman(&wright, &mini, 0.95).expect("varies");
    assert!((agreement.bias - -2.1).abs() < 0.05, "{}", agreement.bias);
    assert!((agreement.sd - 38.8).abs() < 0.05, "{}", agreement.sd);
    // The paper takes two standard deviations: −79.7 and 75.5.
    let two_sd = [agreement.bias - 2.0 * agreement.sd, agreement.bias + 2.0 * agreement.sd];
    assert!((two_sd[0] - -79.7).abs() < 0.1 && (two_sd[1] - 75.5).abs() < 0.1, "{two_sd:?}");
    assert!((pearson(&wright, &mini).expect("varies").r - 0.94).abs() < 0.005);
    // Interval of the bias in the paper: −22.0 to 17.8.
    let [low, high] = agreement.bias_interval_95;
    assert!((low - -22.0).abs() < 0.1 && (high - 17.8).abs() < 0.1, "{low} {high}");
}

/// Anscombe (1973), doi:10.1080/00031305.1973.10478966: first of the four sets.
#[test]
fn val_published_anscombe() {
    let x = [10.0, 8.0, 13.0, 9.0, 11.0, 14.0, 6.0, 4.0, 12.0, 7.0, 5.0];
    let y = [8.04, 6.95, 7.58, 8.81, 8.33, 9.96, 7.24, 4.26, 10.84, 4.82, 5.68];
    let line = linear_regression(&x, &y).expect("varies");
    for (ours, printed) in [(line.slope, 0.5), (line.intercept, 3.0), (line.slope_standard_error, 0.118)] {
        assert!((ours - printed).abs() < 5e-4, "{ours} {printed}");
    }
    assert!((line.r_squared - 0.667).abs() < 5e-4);
}

fn analysis(design: TestDesign, tails: Tails) -> PowerAnalysis {
    PowerAnalysis { design, alpha: 0.05, tails }
}

#[test]
fn val_scipy_power() {
    // statsmodels' and SciPy's noncentral t carry about nine digits themselves.
    const POWER_TOLERANCE: f64 = 1e-8;
    let mut worst = 0.0f64;
    for case in list(&reference()["power"]) {
        let effect = number(&case["effect"]);
        let design = match case["design"].as_str().expect("a design") {
            "paired_t" => TestDesign::PairedT { cohen_d_z: effect },
            "two_sample_t" => TestDesign::TwoSampleT { cohen_d: effect },
            "point_biserial" => TestDesign::PointBiserial { r: effect },
            _ => TestDesign::Correlation { r: effect },
        };
        let tails = if number(&case["tails"]) == 1.0 { Tails::One } else { Tails::Two };
        let ours = analysis(design, tails).power(number(&case["n"]) as usize).expect("in the domain");
        let residual = (ours - number(&case["power"])).abs();
        assert!(residual < POWER_TOLERANCE, "{case}: ours {ours}");
        worst = worst.max(residual);
    }
    println!("largest residual {worst:.1e}");
}

/// The two power analyses of Jadelis (2025).
#[test]
fn val_published_dissertation_power() {
    // Chapter 4: r = 0.64, five participants: 42 %, at least 11 for 80 %. It is G*Power's point biserial model, one
    // tail: the first of its correlation tests.
    let chapter_4 = analysis(TestDesign::PointBiserial { r: 0.64 }, Tails::One);
    assert!((chapter_4.power(5).expect("in the domain") - 0.42).abs() < 0.005);
    assert_eq!(chapter_4.needed_n(0.8), Ok(11));
    // The exact test of a correlation, which the question was about, has 35 % (one tail), 21 % (two), and needs 13 or
    // 16.
    let exact = |tails| analysis(TestDesign::Correlation { r: 0.64 }, tails);
    assert!((exact(Tails::One).power(5).expect("in the domain") - 0.347).abs() < 0.002);
    assert!((exact(Tails::Two).power(5).expect("in the domain") - 0.212).abs() < 0.002);
    assert_eq!((exact(Tails::One).needed_n(0.8), exact(Tails::Two).needed_n(0.8)), (Ok(13), Ok(16)));

    // Chapter 3: d = 0.72, ten participants: 0.67, at least 25 for 80 %. The power is that of the paired test with one
    // tail (0.676; 0.67 from d = 0.715, which also rounds to 0.72).
    let paired = |d, tails| analysis(TestDesign::PairedT { cohen_d_z: d }, tails);
    assert!((paired(0.72, Tails::One).power(10).expect("in the domain") - 0.676).abs() < 5e-4);
    assert!((paired(0.715, Tails::One).power(10).expect("in the domain") - 0.67).abs() < 2e-3);
    // The 25 is the size of each of two independent groups, one tail; the paired test needs 14 (one tail) or 18 (two).
    assert_eq!(analysis(TestDesign::TwoSampleT { cohen_d: 0.72 }, Tails::One).needed_n(0.8), Ok(25));
    assert_eq!(paired(0.72, Tails::One).needed_n(0.8), Ok(14));
    assert_eq!(paired(0.72, Tails::Two).needed_n(0.8), Ok(18));
}

#[test]
fn verif_power_without_effect_is_alpha() {
    for tails in [Tails::One, Tails::Two] {
        for design in [
            TestDesign::PairedT { cohen_d_z: 0.0 },
            TestDesign::TwoSampleT { cohen_d: 0.0 },
            TestDesign::Correlation { r: 0.0 },
            TestDesign::PointBiserial { r: 0.0 },
        ] {
            for n in [3, 4, 10, 500] {
                let power = analysis(design, tails).power(n).expect("in the domain");
                assert!((power - 0.05).abs() < 1e-9, "{design:?} n {n}: {power}");
            }
        }
        assert_eq!(
            analysis(TestDesign::PairedT { cohen_d_z: 0.0 }, tails).needed_n(0.8),
            Err(StatisticsError::SampleSize { limit: 1_000_000, power: 0.8 })
        );
    }
}

#[test]
fn val_scipy_distributions() {
    let reference = reference();
    let mut residuals = Residuals::default();
    for row in list(&reference["distributions"]["t_quantile"]) {
        let v = numbers(row);
        residuals.check("t quantile", t_quantile(v[0], v[1]), v[2]);
    }
    for row in list(&reference["distributions"]["noncentral_t"]) {
        let v = numbers(row);
        residuals.check("noncentral t", noncentral_t_cdf(v[0], v[1], v[2]), v[3]);
    }
    for row in list(&reference["distributions"]["f_tail"]) {
        let v = numbers(row);
        residuals.check("F tail", f_tail(v[0], v[1], v[2]), v[3]);
    }
    println!("largest residual {:.1e}", residuals.0);
}

#[test]
fn verif_faults_of_use_are_errors_with_fields() {
    let factor = || Factor::new("effort", ["25", "50"]);
    assert!(matches!(RepeatedMeasures::new(vec![], &[]), Err(StatisticsError::TooFew { what: "factors", .. })));
    let missing = RepeatedMeasures::new(vec![factor()], &[vec![1.0, 2.0], vec![1.0, f64::NAN]]);
    assert!(matches!(missing, Err(StatisticsError::NotFinite { row: 1, column: 1, .. })));
    let ragged = RepeatedMeasures::new(vec![factor()], &[vec![1.0, 2.0], vec![1.0]]);
    assert!(matches!(ragged, Err(StatisticsError::Length { expected: 2, found: 1, .. })));
    assert!(matches!(pearson(&[1.0; 4], &[1.0, 2.0, 3.0, 4.0]), Err(StatisticsError::NoVariation { .. })));
    assert!(matches!(paired_t_test(&[1.0, 2.0], &[0.0, 1.0]), Err(StatisticsError::NoVariation { .. })));
    let beyond = analysis(TestDesign::Correlation { r: 1.0 }, Tails::Two).power(10);
    assert!(matches!(beyond, Err(StatisticsError::OutOfDomain { what: "correlation", .. })));
    assert!(matches!(
        analysis(TestDesign::Correlation { r: 0.5 }, Tails::Two).power(2),
        Err(StatisticsError::TooFew { .. })
    ));
}

#[test]
fn val_lme4_mixed_models() {
    let reference: Value =
        serde_json::from_str(include_str!("../../fixtures/statistics/mixed_models.json")).expect("valid JSON");
    let mut contrasts = 0;
    for case in list(&reference["cases"]) {
        let y = numbers(&case["y"]);
        let whole = |name: &str| numbers(&case[name]).iter().map(|v| *v as usize).collect::<Vec<_>>();
        let (person, cell) = (whole("person"), whole("cell"));
        let cells = list(&case["coefficients"]).len();
        let x = nalgebra::DMatrix::from_fn(y.len(), cells, |i, j| if cell[i] == j { 1.0 } else { 0.0 });
        let ours = mixed_model(&y, &x, &person).expect("complete data");
        // Theirs is where an optimizer without derivatives ended.
        let theirs = |name: &str| number(&case[name]);
        assert!(ours.criterion <= theirs("criterion") + 1e-10, "{} {}", ours.criterion, theirs("criterion"));
        let close = |what: &str, a: f64, b: f64, tolerance: f64| {
            assert!((a - b).abs() <= tolerance * b.abs(), "{what}: ours {a}, reference {b}");
        };
        close("criterion", ours.criterion, theirs("criterion"), 1e-10);
        close("between", ours.between, theirs("between"), 1e-5);
        close("within", ours.within, theirs("within"), 1e-5);
        for test in list(&case["contrasts"]) {
            let found = ours.contrast(&numbers(&test["weights"])).expect("as many weights as cells");
            let theirs = |name: &str| number(&test[name]);
            close("estimate", found.estimate, theirs("estimate"), 1e-5);
            close("standard error", found.standard_error, theirs("se"), 1e-5);
            close("df", found.df, theirs("df"), 1e-4);
            close("t", found.t, theirs("t"), 1e-5);
            close("p", found.p_value, theirs("p"), 1e-4);
            contrasts += 1;
        }
    }
    assert_eq!(contrasts, 15);
}
