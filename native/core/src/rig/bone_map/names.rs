//! Names of bones in the common schemes, taken apart into side, part and numbers.
//!
//! Known are Rigify, Mixamo, Unreal, MakeHuman's rigs, VRM (both its node names and its humanoid
//! names), 3ds Max Biped, Daz and the joint names of converted MMD models. Any other name keeps its
//! words, so that two skeletons of one unknown scheme still meet.

/// Side of the body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) enum Side {
    Middle,
    Left,
    Right,
}

/// Part of the body that a bone moves.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) enum Part {
    Root,
    Hips,
    Spine,
    Neck,
    Head,
    Jaw,
    Clavicle,
    UpperArm,
    LowerArm,
    Hand,
    Thigh,
    Shin,
    /// Shin beside a thigh, thigh beside a shin.
    Leg,
    Foot,
    Toes,
    /// One toe, 0 the big one.
    Toe(u8),
    /// A finger, 0 the thumb, 4 the little one.
    Finger(u8),
    /// The bone in the palm above a finger.
    Metacarpal(u8),
    /// What no scheme knows: the name's words in alphabetical order.
    Other(String),
}

/// A name taken apart.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct BoneName {
    pub(super) side: Side,
    /// `None` for a name without words, such as "Bone.001".
    pub(super) part: Option<Part>,
    /// All numbers of the name, as written.
    pub(super) numbers: Vec<u32>,
    /// A helper that shares its limb with the main bone.
    pub(super) twist: bool,
    /// The end of a chain that only gives the last bone its tail.
    pub(super) tip: bool,
    /// A bone for the animator's hand, not for the skin.
    pub(super) control: bool,
    /// Marked as deforming by Rigify's prefix.
    pub(super) deform: bool,
}

const SCHEME_WORDS: [&str; 18] = [
    "mixamorig",
    "bip",
    "biped",
    "valve",
    "j",
    "b",
    "bn",
    "bone",
    "jnt",
    "joint",
    "skeleton",
    "armature",
    "def",
    "org",
    "cc",
    "character",
    "c",
    "f",
];
const CONTROL_WORDS: [&str; 11] =
    ["ik", "fk", "pole", "target", "ctrl", "control", "tweak", "mch", "socket", "helper", "parent"];
const TIP_WORDS: [&str; 5] = ["end", "leaf", "nub", "tip", "site"];
const TWIST_WORDS: [&str; 3] = ["twist", "roll", "twst"];

impl BoneName {
    pub(super) fn new(name: &str) -> Self {
        let local = name.rsplit([':', '|']).next().unwrap_or(name);
        let mut words = split_words(local);
        let has = |words: &[String], any: &[&str]| words.iter().any(|word| any.contains(&word.as_str()));
        let deform = words.first().is_some_and(|word| word == "def");
        let (control, tip) = (has(&words, &CONTROL_WORDS), has(&words, &TIP_WORDS));
        let twist = has(&words, &TWIST_WORDS);
        let is = |word: &str, any: &[&str]| any.contains(&word);
        let left = words.iter().any(|word| is(word, &["l", "left", "lft"]));
        let right = words.iter().any(|word| is(word, &["r", "right", "rgt"]));
        let side = match (left, right) {
            (true, false) => Side::Left,
            (false, true) => Side::Right,
            _ => Side::Middle,
        };
        // The number of "Bip001" and of "mixamorig1" belongs to the scheme.
        for at in (1..words.len()).rev() {
            if is(&words[at - 1], &["bip", "biped", "mixamorig", "character"]) && is_number(&words[at]) {
                words.remove(at);
            }
        }
        if side != Side::Middle {
            words.retain(|word| !is(word, &["l", "left", "lft", "r", "right", "rgt"]));
        }
        words.retain(|word| !SCHEME_WORDS.contains(&word.as_str()) && !TWIST_WORDS.contains(&word.as_str()));
        let digits: Vec<String> = words.iter().filter(|word| is_number(word)).cloned().collect();
        words.retain(|word| !is_number(word));
        let part = part_of(side, &words, &digits, tip || control);
        let numbers = digits.iter().filter_map(|number| number.parse().ok()).collect();
        Self { side, part, numbers, twist, tip, control, deform }
    }
}

fn is_number(word: &str) -> bool {
    word.starts_with(|c: char| c.is_ascii_digit())
}

/// Words of a name in lower case: cut at signs, between letters and digits, and at capitals.
fn split_words(name: &str) -> Vec<String> {
    let letters: Vec<char> = name.chars().collect();
    let mut words: Vec<String> = Vec::new();
    for (at, &letter) in letters.iter().enumerate() {
        if !letter.is_alphanumeric() {
            words.push(String::new());
            continue;
        }
        let before = at.checked_sub(1).map(|b| letters[b]).filter(|b| b.is_alphanumeric());
        let starts = before.is_none_or(|b| {
            let next_is_small = letters.get(at + 1).is_some_and(|n| n.is_lowercase());
            b.is_ascii_digit() != letter.is_ascii_digit()
                || (letter.is_uppercase() && (b.is_lowercase() || (b.is_uppercase() && next_is_small)))
        });
        if starts {
            words.push(String::new());
        }
        if let Some(word) = words.last_mut() {
            word.extend(letter.to_lowercase());
        }
    }
    words.retain(|word| !word.is_empty());
    words
}

fn part_of(side: Side, words: &[String], digits: &[String], opaque: bool) -> Option<Part> {
    let joined: String = words.concat();
    let other = |plain: Option<&str>| {
        let mut sorted: Vec<String> =
            words.iter().filter(|word| Some(word.as_str()) != plain).cloned().collect();
        sorted.sort();
        (!sorted.is_empty()).then(|| Part::Other(sorted.join(" ")))
    };
    let quadruped =
        ["front", "hind", "rear"].iter().any(|word| joined.starts_with(word) || joined.ends_with(word))
            || (joined.starts_with("back") && joined.len() > "back".len())
            || (joined.starts_with("fore") && !joined.contains("forearm") && !joined.contains("finger"));
    if opaque || quadruped {
        // "FrontUpperLeg" and "FrontUpper" are one bone, "BackLeg" is not "Back".
        return other((quadruped && words.len() > 2).then_some("leg"));
    }
    let known = if side == Side::Middle { middle_part(&joined) } else { sided_part(&joined, digits) };
    known.or_else(|| other(None))
}

fn middle_part(joined: &str) -> Option<Part> {
    Some(match joined {
        "root" | "master" | "reference" => Part::Root,
        "hips" | "hip" | "pelvis" => Part::Hips,
        "spine" | "chest" | "upperchest" | "chestupper" | "chestlower" | "lowerchest" | "torso"
        | "abdomen" | "abdomenupper" | "abdomenlower" | "upperabdomen" | "lowerabdomen" | "waist"
        | "back" | "ribcage" => Part::Spine,
        "neck" | "neckupper" | "necklower" | "upperneck" | "lowerneck" => Part::Neck,
        "head" | "skull" => Part::Head,
        "jaw" | "chin" => Part::Jaw,
        _ => return None,
    })
}

fn sided_part(joined: &str, digits: &[String]) -> Option<Part> {
    let number = |at: usize| digits.get(at).and_then(|digit| digit.parse::<u8>().ok());
    let mut finger = joined.to_owned();
    for word in ["hand", "finger", "proximal", "intermediate", "distal", "phalanx", "phalange"] {
        finger = finger.replace(word, "");
    }
    if joined.contains("toe") {
        return Some(match (joined, digits.len()) {
            ("toe", 2) => Part::Toe(number(0)?.saturating_sub(1)),
            ("toe" | "toes" | "toebase", _) => Part::Toes,
            _ => return None,
        });
    }
    if let Some(index) = finger_index(&finger) {
        return Some(Part::Finger(index));
    }
    let palm = |word: &&str| finger.strip_suffix(*word).or_else(|| finger.strip_prefix(*word));
    if let Some(which) = ["metacarpal", "palm", "in"].iter().find_map(palm) {
        match finger_index(which) {
            Some(0) => return Some(Part::Finger(0)),
            Some(index) => return Some(Part::Metacarpal(index)),
            None if which.is_empty() => {
                return number(0).filter(|n| (1..=4).contains(n)).map(Part::Metacarpal);
            }
            None => {}
        }
    }
    if joined == "finger" {
        // "finger2-1" counts from the thumb as 1, "Finger11" from the thumb as 0.
        let index = match digits {
            [_, _, ..] => number(0)?.checked_sub(1)?,
            [digit] => digit.chars().next()?.to_digit(10)? as u8,
            [] => return None,
        };
        return (index < 5).then_some(Part::Finger(index));
    }
    Some(match joined {
        "clavicle" | "shoulder" | "collar" | "collarbone" => Part::Clavicle,
        "upperarm" | "arm" | "uparm" | "shldr" | "shldrbend" | "armupper" | "bicep" | "humerus" => {
            Part::UpperArm
        }
        "lowerarm" | "forearm" | "forearmbend" | "elbow" | "armlower" | "lowarm" | "loarm" => Part::LowerArm,
        "hand" | "wrist" => Part::Hand,
        "thigh" | "thighbend" | "upleg" | "upperleg" | "legupper" | "femur" => Part::Thigh,
        "calf" | "shin" | "lowerleg" | "leglower" | "lowleg" | "loleg" | "knee" => Part::Shin,
        "leg" => Part::Leg,
        "foot" | "ankle" => Part::Foot,
        "ball" => Part::Toes,
        "pelvis" | "hip" | "hips" => Part::Hips,
        _ => return None,
    })
}

fn finger_index(word: &str) -> Option<u8> {
    Some(match word {
        "thumb" => 0,
        "index" | "fore" => 1,
        "middle" | "mid" => 2,
        "ring" => 3,
        "pinky" | "pinkie" | "little" | "small" => 4,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_scheme_says_the_same() {
        let (left, right, middle) = (Side::Left, Side::Right, Side::Middle);
        for (side, part, names) in [
            (
                left,
                Part::LowerArm,
                "mixamorig:LeftForeArm lowerarm_l lowerarm01.L DEF-forearm.L.001 J_Bip_L_LowerArm \
                leftLowerArm lForearmBend forearm-l lowerarm_twist_01_l Bip001_L_Forearm LeftElbow",
            ),
            (
                right,
                Part::UpperArm,
                "mixamorig1:RightArm upperarm_r upperarm02.R ORG-upper_arm.R J_Bip_R_UpperArm rShldrBend",
            ),
            (
                left,
                Part::Clavicle,
                "LeftShoulder clavicle_l shoulder01.L shoulder.L J_Bip_L_Shoulder lCollar",
            ),
            (left, Part::Hand, "LeftHand hand_l wrist.L DEF-hand.L J_Bip_L_Hand"),
            (
                right,
                Part::Thigh,
                "RightUpLeg thigh_r upperleg01.R DEF-thigh.R.001 J_Bip_R_UpperLeg thigh_twist_01_r",
            ),
            (right, Part::Shin, "calf_r lowerleg02.R DEF-shin.R J_Bip_R_LowerLeg RightKnee"),
            (left, Part::Leg, "mixamorig:LeftLeg"),
            (left, Part::Foot, "LeftFoot foot_l foot.L J_Bip_L_Foot lFoot LeftAnkle"),
            (left, Part::Toes, "LeftToeBase ball_l DEF-toe.L J_Bip_L_ToeBase leftToes"),
            (left, Part::Toe(0), "toe1-1.L toe1-2.L"),
            (
                left,
                Part::Finger(0),
                "LeftHandThumb1 thumb_01_l finger1-1.L thumb.02.L J_Bip_L_Thumb1 leftThumbMetacarpal \
                lThumb3 Bip01_L_Finger0 Bip01_L_Finger02",
            ),
            (
                right,
                Part::Finger(1),
                "RightHandIndex3 index_01_r finger2-3.R DEF-f_index.02.R J_Bip_R_Index2 \
                rightIndexIntermediate IndexFinger1_R Bip01_R_Finger1 Bip01_R_Finger12",
            ),
            (
                left,
                Part::Finger(4),
                "LeftHandPinky1 pinky_03_l finger5-1.L f_pinky.01.L J_Bip_L_Little3 leftLittleDistal",
            ),
            (left, Part::Metacarpal(1), "metacarpal1.L palm.01.L index_metacarpal_l LeftInHandIndex"),
            (
                middle,
                Part::Spine,
                "mixamorig:Spine2 spine_01 spine05 DEF-spine.003 J_Bip_C_UpperChest chest abdomenLower",
            ),
            (middle, Part::Hips, "mixamorig:Hips pelvis J_Bip_C_Hips Bip01_Pelvis hip"),
            (middle, Part::Neck, "mixamorig:Neck neck_01 neck03 J_Bip_C_Neck"),
        ] {
            for name in names.split_whitespace() {
                let found = BoneName::new(name);
                assert_eq!((found.side, found.part), (side, Some(part.clone())), "{name}");
            }
        }
    }

    #[test]
    fn helpers_and_ends_are_told_apart() {
        assert!(BoneName::new("upperarm_twist_01_l").twist && !BoneName::new("upperarm_l").twist);
        assert!(BoneName::new("HeadTop_End").tip && BoneName::new("index_04_leaf_l").tip);
        assert!(BoneName::new("MCH-forearm.L").control && BoneName::new("hand_ik.L").control);
        assert!(BoneName::new("DEF-spine").deform);
        assert_eq!(BoneName::new("Bone.001").part, None);
        let words = |name| BoneName::new(name).part;
        assert_eq!(words("FrontUpperLeg.L"), words("Front_Leg_Upper_L"));
        assert_ne!(words("FrontUpperLeg.L"), Some(Part::Thigh));
        assert_eq!(BoneName::new("b_RightForeArm_07").part, Some(Part::LowerArm));
    }
}
