//! Writes what the target starts from to `corpus/`, beside this file: our robots, and short made-up
//! ones that have every element.

use std::{fs, fs::File, io::Write, path::Path};

const SHORT: [&str; 4] = [
    "<robot name='r'><link name='a'/></robot>",
    "<?xml version='1.0'?><!-- c --><robot name='r'><link name='a'><inertial><origin xyz='0 0 1' \
     rpy='1 2 3'/><mass value='1'/><inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' izz='1'/>\
     </inertial><collision><origin xyz='0 0 1'/><geometry><box size='1 2 3'/></geometry></collision>\
     <collision><geometry><sphere radius='1'/></geometry></collision><collision><geometry>\
     <cylinder radius='1' length='2'/></geometry></collision><collision><geometry><capsule \
     radius='1' length='2'/></geometry></collision><visual><geometry><mesh \
     filename='package://a/b.stl'/></geometry></visual></link></robot>",
    "<robot name='r'><link name='a'/><link name='b'/><link name='c'/><link name='d'/>\
     <joint name='j' type='revolute'><origin xyz='0 0 .1' rpy='0 1 0'/><parent link='a'/>\
     <child link='b'/><axis xyz='0 1 0'/><limit lower='-1' upper='1e0' effort='1' velocity='2'/>\
     </joint><joint name='k' type='prismatic'><parent link='b'/><child link='c'/><axis \
     xyz='1 0 0'/><limit lower='0' upper='0.1'/><mimic joint='j' multiplier='2' offset='0.1'/>\
     </joint><joint name='l' type='continuous'><parent link='b'/><child link='d'/></joint></robot>",
    "<!DOCTYPE r [<!ENTITY a 'b'>]><robot name='&a;'><xacro:include/><link name='${a}'/></robot>",
];

fn main() {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let corpus = here.join("corpus/urdf");
    fs::create_dir_all(&corpus).unwrap();
    let save = |name: &str, bytes: &[u8]| {
        File::create(corpus.join(name))
            .unwrap()
            .write_all(bytes)
            .unwrap();
    };
    for (idx, text) in SHORT.iter().enumerate() {
        save(&format!("short_{idx}"), text.as_bytes());
    }
    for folder in ["../../../../data/robots", "../tests/golden"] {
        for entry in fs::read_dir(here.join(folder)).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|extension| extension == "urdf") {
                let name = path.file_stem().unwrap().to_string_lossy().into_owned();
                save(&name, &fs::read(&path).unwrap());
            }
        }
    }
}
