//! Grouped bars with error bars, and heat maps, as SVG text.

use std::fmt::Write;

use super::plot::{Scale, escape, tick_label, ticks};

/// Series that have a colour of their own.
pub const COLOURS: usize = 10;

/// Bars in groups: groups along the axis, one bar a series in each.
#[derive(Clone, Debug)]
pub struct BarFigure {
    /// What a screen reader says.
    pub description: String,
    /// Names of the groups.
    pub groups: Vec<String>,
    /// Names of the series.
    pub series: Vec<String>,
    /// Mean and standard deviation, group by group, series by series; `None` where there is none.
    pub values: Vec<Vec<Option<(f64, f64)>>>,
    /// Drawing size.
    pub size: [f64; 2],
}

impl BarFigure {
    /// The figure as SVG; bars begin at zero, whiskers reach one standard deviation to both sides.
    pub fn svg(&self) -> String {
        let [width, height] = self.size;
        let (left, right, top, bottom) = (40.0, 8.0, 8.0, 24.0);
        let all = || self.values.iter().flatten().flatten();
        let low = all().map(|(m, s)| (m - s).min(0.0)).fold(0.0, f64::min).max(-1.0);
        let high = all().map(|(m, s)| m + s).fold(1e-9, f64::max);
        let y = Scale { data: [low, high * 1.04], drawn: [height - bottom, top] };
        let mut w = format!(
            r#"<svg class="figure" viewBox="0 0 {width} {height}" role="img" aria-label="{}">"#,
            escape(&self.description)
        );
        let marks = ticks(y.data[0], y.data[1], 5);
        let step = marks.windows(2).map(|t| t[1] - t[0]).next().unwrap_or(1.0);
        for value in &marks {
            let (at, label) = (y.at(*value), tick_label(*value, step));
            let class = if value.abs() < 1e-12 { "zero" } else { "grid" };
            let _ =
                write!(w, r#"<line class="{class}" x1="{left}" x2="{}" y1="{at:.1}" y2="{at:.1}"/>"#, width - right);
            let _ = write!(w, r#"<text class="tick y" x="{:.1}" y="{:.1}">{label}</text>"#, left - 5.0, at + 3.5);
        }
        let room = (width - left - right) / self.groups.len().max(1) as f64;
        let bar = room * 0.84 / self.series.len().max(1) as f64;
        for (g, (name, values)) in self.groups.iter().zip(&self.values).enumerate() {
            let begin = left + room * (g as f64 + 0.08);
            for (s, value) in values.iter().enumerate() {
                let Some((mean, sd)) = value else { continue };
                let x = begin + bar * s as f64;
                let (a, b) = (y.at(0.0), y.at(*mean));
                let title = format!("{}, {name}: {mean:.3} ± {sd:.3}", self.series[s]);
                let _ = write!(
                    w,
                    "<rect class=\"column c{}\" x=\"{x:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\">\
                     <title>{}</title></rect>",
                    s % COLOURS,
                    a.min(b),
                    bar * 0.9,
                    (a - b).abs().max(0.3),
                    escape(&title)
                );
                let (middle, up, down) = (x + bar * 0.45, y.at(mean + sd), y.at((mean - sd).max(low)));
                let _ = write!(
                    w,
                    r#"<line class="whisker" x1="{middle:.1}" x2="{middle:.1}" y1="{up:.1}" y2="{down:.1}"/>"#
                );
            }
            let middle = left + room * (g as f64 + 0.5);
            let _ = write!(
                w,
                r#"<text class="tick" text-anchor="middle" x="{middle:.1}" y="{:.1}">{}</text>"#,
                height - 8.0,
                escape(name)
            );
        }
        w.push_str("</svg>");
        w
    }
}

/// The legend of a [`BarFigure`]'s series.
pub fn legend(series: &[String]) -> String {
    legend_in(series, 1)
}

/// As [`legend`], where every `step`th colour is used.
pub fn legend_in(series: &[String], step: usize) -> String {
    series.iter().enumerate().fold(String::new(), |mut text, (i, name)| {
        let colour = step * i % COLOURS;
        let _ = write!(text, r#"<span class="swatch"><i class="square c{colour}"></i>{}</span>"#, escape(name));
        text
    })
}

/// A square table of p-values: cells below 0.05 and 0.01 are marked.
pub fn heat_map(description: &str, names: &[String], p: &[Vec<Option<f64>>]) -> String {
    let (left, cell) = (64.0, 34.0);
    let width = left + cell * names.len() as f64 + 4.0;
    let height = 18.0 + cell * names.len() as f64 + 4.0;
    let mut w = format!(
        r#"<svg class="figure" viewBox="0 0 {width} {height}" role="img" aria-label="{}">"#,
        escape(description)
    );
    for (i, name) in names.iter().enumerate() {
        let at = 18.0 + cell * (i as f64 + 0.5);
        let _ = write!(w, r#"<text class="tick y" x="{:.1}" y="{:.1}">{}</text>"#, left - 5.0, at + 3.5, escape(name));
        let across = left + cell * (i as f64 + 0.5);
        let _ = write!(w, r#"<text class="tick" text-anchor="middle" x="{across:.1}" y="12">{}</text>"#, escape(name));
        for (j, value) in p[i].iter().enumerate() {
            let Some(value) = value else { continue };
            let (class, mark) = match *value {
                p if p < 0.01 => ("heat strong", "**"),
                p if p < 0.05 => ("heat some", "*"),
                _ => ("heat", ""),
            };
            let (x, y) = (left + cell * j as f64, 18.0 + cell * i as f64);
            let _ = write!(
                w,
                "<rect class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\" width=\"{:.1}\" height=\"{:.1}\">\
                 <title>{} – {}: p = {value:.4}</title></rect>",
                cell - 2.0,
                cell - 2.0,
                escape(name),
                escape(&names[j])
            );
            let _ = write!(
                w,
                r#"<text class="tick" text-anchor="middle" x="{:.1}" y="{:.1}">{mark}</text>"#,
                x + cell / 2.0 - 1.0,
                y + cell / 2.0 + 4.0
            );
        }
    }
    w.push_str("</svg>");
    w
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_every_value_has_a_bar_and_a_whisker() {
        let figure = BarFigure {
            description: "d".into(),
            groups: vec!["a".into(), "b".into()],
            series: vec!["x".into(), "y".into()],
            values: vec![vec![Some((1.0, 0.1)), Some((-0.5, 0.2))], vec![None, Some((2.0, 0.3))]],
            size: [400.0, 200.0],
        };
        let svg = figure.svg();
        assert_eq!(svg.matches("<rect class=\"column").count(), 3);
        assert_eq!(svg.matches("class=\"whisker\"").count(), 3);
        assert!(legend(&figure.series).contains("square c1"));
        let map = heat_map("d", &["a".into(), "b".into()], &[vec![None, Some(0.03)], vec![Some(0.001), None]]);
        assert_eq!(map.matches("<rect").count(), 2);
        assert!(map.contains("heat some") && map.contains(">**<"));
    }
}
