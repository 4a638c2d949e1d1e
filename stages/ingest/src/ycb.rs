//! The objects that `DexYCB` numbers, and behind them YCB's ball: names and true masses.
//!
//! Masses: Calli et al., *The YCB Object and Model Set*, 2015, table I. (The download script of the
//! same authors gives the gelatin box ten times its weight; here it has its own.)

/// Name and mass in kilograms of the objects, in the order of their numbers from 1.
const OBJECTS: [(&str, f64); 22] = [
    ("002_master_chef_can", 0.414),
    ("003_cracker_box", 0.411),
    ("004_sugar_box", 0.514),
    ("005_tomato_soup_can", 0.349),
    ("006_mustard_bottle", 0.603),
    ("007_tuna_fish_can", 0.171),
    ("008_pudding_box", 0.187),
    ("009_gelatin_box", 0.097),
    ("010_potted_meat_can", 0.370),
    ("011_banana", 0.066),
    ("019_pitcher_base", 0.178),
    ("021_bleach_cleanser", 1.131),
    ("024_bowl", 0.147),
    ("025_mug", 0.118),
    ("035_power_drill", 0.895),
    ("036_wood_block", 0.729),
    ("037_scissors", 0.082),
    ("040_large_marker", 0.0158),
    ("051_large_clamp", 0.125),
    ("052_extra_large_clamp", 0.202),
    ("061_foam_brick", 0.028),
    ("056_tennis_ball", 0.058),
];

/// Returns the name of the object with this number (1 to 22).
pub(crate) fn name(number: u32) -> Option<&'static str> {
    let idx = usize::try_from(number).ok()?.checked_sub(1)?;
    OBJECTS.get(idx).map(|&(name, _)| name)
}

/// Returns the number of an object (1 to 22).
pub(crate) fn number(object: &str) -> Option<u32> {
    let idx = OBJECTS.iter().position(|(name, _)| *name == object)?;
    u32::try_from(idx + 1).ok()
}

/// Returns the true mass of an object in kilograms.
pub(crate) fn mass_kg(object: &str) -> Option<f64> {
    OBJECTS
        .iter()
        .find(|(name, _)| *name == object)
        .map(|&(_, mass_kg)| mass_kg)
}
