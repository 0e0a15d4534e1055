//! Numbers drawn from a seed, and the values, expressions and names that programs are made of.

use super::Generator;

/// Numbers drawn by SplitMix64.
pub struct Draw(u64);

impl Draw {
    pub fn new(seed: u64) -> Draw {
        let mut draw = Draw(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0x5DEE_CE66_D1CE_4E5B);
        draw.next();
        draw
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^ (mixed >> 31)
    }

    /// From 0 to below `end`.
    pub fn below(&mut self, end: usize) -> usize {
        (self.next() % end.max(1) as u64) as usize
    }

    /// True once in `of` times.
    pub fn once_in(&mut self, of: usize) -> bool {
        self.below(of) == 0
    }

    pub fn pick<'a, T: ?Sized>(&mut self, from: &[&'a T]) -> &'a T {
        from[self.below(from.len())]
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// One or two characters changed, added or left out.
pub fn mutated(text: &str, draw: &mut Draw) -> String {
    let mut bytes: Vec<u8> = text.bytes().collect();
    for _ in 0..=draw.below(2) {
        let at = draw.below(bytes.len());
        let other = *b"XYZGMFIJKRPQLNO0123456789.-+*/[]()#<>=%; \n@^T"
            .get(draw.below(44))
            .unwrap_or(&b' ');
        match draw.below(3) {
            0 => bytes[at] = other,
            1 => bytes.insert(at, other),
            _ => {
                bytes.remove(at);
            }
        }
    }
    String::from_utf8(bytes).unwrap_or_default()
}

impl Generator {
    /// A line, as people write it.
    pub(super) fn line(&mut self, words: &str) {
        let mut line = String::new();
        if self.draw.once_in(12) {
            line += &format!("N{} ", 10 * (1 + self.draw.below(900)));
        }
        match self.draw.below(12) {
            0 => line += &words.replace(' ', ""),
            1 => line += &words.to_ascii_lowercase(),
            2 => line += &words.replace(' ', "  "),
            _ => line += words,
        }
        match self.draw.below(24) {
            0 => line += " (a comment)",
            1 => line += " ; a comment",
            _ => {}
        }
        self.text += &line;
        self.text += "\n";
    }

    pub(super) fn any_parameter(&mut self) -> String {
        let known = self.parameters.len();
        match self.draw.below(4) {
            0 | 1 if known > 0 => self.parameters[self.draw.below(known)].clone(),
            2 => {
                let known = [
                    "#<_x>",
                    "#<_y>",
                    "#<_z>",
                    "#<_a>",
                    "#<_feed>",
                    "#<_rpm>",
                    "#<_motion_mode>",
                    "#<_plane>",
                    "#<_coord_system>",
                    "#<_absolute>",
                    "#<_metric>",
                    "#<_imperial>",
                    "#<_incremental>",
                    "#<_current_tool>",
                    "#<_tool_offset>",
                    "#<_spindle_on>",
                    "#<_spindle_cw>",
                    "#<_mist>",
                    "#<_flood>",
                    "#<_ijk_absolute_mode>",
                    "#<_inverse_time>",
                    "#<_units_per_minute>",
                    "#<_ccomp>",
                    "#<_metric>",
                ];
                known[self.draw.below(known.len() - 2)].to_owned()
            }
            _ => {
                let known = [
                    "#5420", "#5421", "#5422", "#5423", "#5220", "#5221", "#5222", "#5223",
                    "#5230", "#5241", "#5211", "#5212", "#5210", "#5161", "#5162", "#5181",
                    "#5061", "#5063", "#5070", "#5400", "#5401", "#5403", "#5410", "#5425",
                ];
                known[self.draw.below(known.len())].to_owned()
            }
        }
    }

    pub(super) fn number(&mut self) -> String {
        let value = match self.draw.below(6) {
            0 => self.draw.below(10) as f64,
            1 => 0.0,
            2 => (self.draw.between(-100.0, 100.0) * 10.0).round() / 10.0,
            3 => (self.draw.between(-10.0, 10.0) * 1e4).round() / 1e4,
            _ => (self.draw.between(-50.0, 50.0) * 1e3).round() / 1e3,
        };
        match self.draw.below(10) {
            0 if value.fract() == 0.0 => format!("{value}."),
            1 if value >= 0.0 => format!("+{value}"),
            2 => format!("{value:.4}"),
            3 => format!("{value:.3}").replace("0.", "."),
            _ => format!("{value}"),
        }
    }

    /// A number, a parameter or an expression in brackets.
    pub(super) fn value(&mut self) -> String {
        match self.draw.below(10) {
            0..=6 => self.number(),
            7 if !self.parameters.is_empty() => {
                self.parameters[self.draw.below(self.parameters.len())].clone()
            }
            8 => self.function(2),
            _ => format!("[{}]", self.expression(3)),
        }
    }

    pub(super) fn function(&mut self, depth: usize) -> String {
        let name = self.draw.pick(&[
            "ABS", "SIN", "COS", "TAN", "SQRT", "ROUND", "FIX", "FUP", "ATAN", "ASIN", "ACOS",
            "EXP", "LN", "EXISTS",
        ]);
        match name {
            "ATAN" => format!(
                "ATAN[{}]/[{}]",
                self.expression(depth),
                self.expression(depth)
            ),
            "SQRT" => format!("SQRT[ABS[{}]]", self.expression(depth)),
            "LN" => format!("LN[1+ABS[{}]]", self.expression(depth)),
            "ASIN" | "ACOS" => format!("{name}[.{}]", self.draw.below(100)),
            "EXP" => format!("EXP[{}]", self.draw.below(5)),
            "EXISTS" => {
                let known = self
                    .parameters
                    .iter()
                    .find(|name| name.contains('<'))
                    .cloned();
                format!("EXISTS[{}]", known.unwrap_or("#<nothing>".into()))
            }
            _ => format!("{name}[{}]", self.expression(depth)),
        }
    }

    pub(super) fn expression(&mut self, depth: usize) -> String {
        if depth == 0 || self.draw.once_in(3) {
            return match self.draw.below(4) {
                0 if !self.parameters.is_empty() => {
                    self.parameters[self.draw.below(self.parameters.len())].clone()
                }
                1 => self.draw.below(20).to_string(),
                _ => self.number(),
            };
        }
        match self.draw.below(10) {
            0 => self.function(depth - 1),
            1 => format!("[{}]", self.expression(depth - 1)),
            2 => format!("-[{}]", self.expression(depth - 1)),
            3 => format!("[{}] ** {}", self.draw.below(9), self.draw.below(4)),
            4 => {
                let by = 1 + self.draw.below(9);
                let operator = self.draw.pick(&["/", "MOD"]);
                format!("{} {operator} {by}", self.expression(depth - 1))
            }
            5 => {
                let operator = self
                    .draw
                    .pick(&["EQ", "NE", "GT", "GE", "LT", "LE", "AND", "OR", "XOR"]);
                format!(
                    "{} {operator} {}",
                    self.expression(depth - 1),
                    self.expression(depth - 1)
                )
            }
            _ => {
                let operator = self.draw.pick(&["+", "-", "*", " + ", " - ", " * "]);
                format!(
                    "{}{operator}{}",
                    self.expression(depth - 1),
                    self.expression(depth - 1)
                )
            }
        }
    }

    pub(super) fn axis_words(&mut self, least: usize) -> String {
        let letters = if self.draw.once_in(6) {
            "XYZABCUVW"
        } else {
            "XYZ"
        };
        let chosen: Vec<char> = letters.chars().filter(|_| self.draw.once_in(2)).collect();
        let chosen = if chosen.len() < least {
            vec!['X']
        } else {
            chosen
        };
        let words = chosen
            .into_iter()
            .map(|letter| format!(" {letter}{}", self.value()));
        words.collect()
    }

    pub(super) fn feed_word(&mut self) -> String {
        if self.inverse_time || !self.fed || self.draw.once_in(8) {
            self.fed = true;
            return format!(" F{}", 1 + self.draw.below(2000));
        }
        String::new()
    }

    pub(super) fn name(&mut self) -> String {
        match self.draw.below(4) {
            0 => format!("#<local{}>", self.draw.below(4)),
            1 => format!("#<_global{}>", self.draw.below(4)),
            2 => format!("#{}", 31 + self.draw.below(9)),
            _ => format!("#{}", 100 + self.draw.below(20)),
        }
    }
}
