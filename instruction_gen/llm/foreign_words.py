"""Words of indoor routes in Chinese and Hindi; nouns with patterns of what the English may say."""

SCRIPT = {"zh": "CJK UNIFIED", "hi": "DEVANAGARI"}
LEFT = {"zh": r"左", "hi": r"बाएँ|बाएं|बायीं|बाईं|बायें|बाँए|बाँई"}
RIGHT = {"zh": r"右", "hi": r"दाएँ|दाएं|दायीं|दाईं|दायें|दाहिन"}
TURN_LEFT = {
    "zh": r"左转|左拐|左轉|[向往朝]左",
    "hi": rf"(?:{LEFT['hi']})\S*(?: ओर| तरफ)? (?:मुड़|मोड़|मुड)",
}
TURN_RIGHT = {
    "zh": r"右转|右拐|右轉|[向往朝]右",
    "hi": rf"(?:{RIGHT['hi']})\S*(?: ओर| तरफ)? (?:मुड़|मोड़|मुड)",
}
STOP = {"zh": r"停|等", "hi": r"रुक|रूक|ठहर|प्रतीक्षा|इंतज़ार|इंतजार"}
DISTANCE = {"zh": r"([一二两三四五六七八九十]|\d+)\s*(?:米|公尺)", "hi": r"(\S+) मीटर"}
NUMBER_WORDS = {
    "zh": {c: n for n, c in enumerate("零一二三四五六七八九十")} | {"两": 2},
    "hi": {
        "एक": 1, "दो": 2, "तीन": 3, "चार": 4, "पाँच": 5, "पांच": 5, "छह": 6, "छः": 6, "सात": 7,
        "आठ": 8, "नौ": 9, "दस": 10,
    },
}  # fmt: skip
# A count stands before a classifier in Chinese, and right before its noun in Hindi, where दो also
# ends a request.
COUNT = {
    "zh": r"(?<![第一二三四五六七八九十\d])([二两三四五六七八九]|\d+)[把张張个個台盏扇株盆件幅面]",
    "hi": r"(?:^|\s)(दो|तीन|चार|पाँच|पांच|छह|छः|सात|\d+) (?=(?:{nouns}))",
}
# दूसरा is also "the other", so it says no number.
ORDINAL = {
    "zh": {2: "第[二2]", 3: "第[三3]", 4: "第[四4]"},
    "hi": {3: r"तीसर[ाीे]", 4: r"चौथ[ाीे]"},
}
COLOUR_WORDS = {
    "zh": {
        "(?<!粉)红色": "red", "蓝色": "blue", "绿色": "green", "黄色": "yellow", "黑色": "black",
        "白色": "white", "灰色": "grey", "[棕褐]色": "brown", "紫色": "purple",
        "粉红?色": "pink", "橙色|橘色": "orange", "米色": "beige",
    },
    "hi": {
        "लाल": "red", "नील[ाीे]": "blue", "हर[ाीे](?= )": "green", "पील[ाीे]": "yellow",
        "काल[ाीे]": "black", "सफ़ेद|सफेद": "white", "स्लेटी|धूसर|ग्रे ": "grey",
        "भूर[ाीे]": "brown", "बैंगनी": "purple", "गुलाबी": "pink", "नारंगी": "orange",
    },
}  # fmt: skip

_TABLE, _CHAIR, _BATH = r"(?:\w+ )?table|desk", r"(?:\w+ )?chair|armchair|stool|seat", "bathroom"
NOUNS = {
    "zh": {
        "厨房": "kitchen", "卧室": "bedroom", "客厅": "living room|lounge", "浴室": _BATH,
        "卫生间": f"{_BATH}|restroom", "洗手间": f"{_BATH}|restroom", "走廊": "hall|corridor",
        "餐厅": "dining", "书房": "office|study",
        "办公室": "office|study", "健身房": "exercise|gym",
        "沙发": "sofa|couch|armchair", "床": "bed", "床头柜": "nightstand|bedside",
        "茶几": "coffee",
        "餐桌": _TABLE, "书桌": "desk", "桌": _TABLE, "扶手椅": "armchair", "长椅": "bench",
        "长凳": "bench", "椅": _CHAIR, "冰箱": "refrigerator|fridge", "马桶": "toilet",
        "浴缸": "bath|tub", "电视柜": "tv|television", "电视": "tv|television", "书架": "book",
        "衣柜": "wardrobe|closet", "鞋柜": "shoe", "衣帽架": "coat", "镜子": "mirror",
        "植物": "plant", "盆栽": "plant", "洗衣机": "wash", "钢琴": "piano", "壁炉": "fireplace",
        "楼梯": "stair", "地毯": "rug|carpet|mat", "暖气": "radiator|heat", "窗帘": "curtain|drape",
        "台灯": "lamp|light", "落地灯": "lamp|light", "洗手池": "sink|basin",
        "洗脸盆": "sink|basin", "水槽": "sink|basin", "餐边柜": "sideboard|buffet|cabinet",
        "斗柜": "dresser|drawers",
        "五斗橱": "dresser|drawers", "垃圾桶": "bin|trash|garbage", "篮子": "basket|hamper",
        "橱柜": "counter|cabinet|cupboard", "料理台": "counter|worktop",
        "脚凳": "pouf|ottoman|stool",
        "儿童房": "child|kid", "毛巾架": "towel", "淋浴": "shower", "窗": "window",
    },
    "hi": {
        "रसोई": "kitchen", "किचन": "kitchen", "बेडरूम": "bedroom", "शयनकक्ष": "bedroom",
        "बैठक": "living room|lounge", "लिविंग रूम": "living room|lounge", "बाथरूम": _BATH,
        "स्नानघर": _BATH, "गलियार": "hall|corridor", "हॉलवे": "hall|corridor",
        "डाइनिंग": "dining", "भोजन कक्ष": "dining", "ऑफिस": "office|study",
        "सोफ़": "sofa|couch", "सोफा": "sofa|couch", "सोफे": "sofa|couch", "बिस्तर": "bed",
        "पलंग": "bed", "मेज": _TABLE, "मेज़": _TABLE, "कुर्सी": _CHAIR, "कुर्सियों": _CHAIR,
        "फ्रिज": "refrigerator|fridge", "रेफ्रिजरेटर": "refrigerator|fridge",
        "टॉयलेट": "toilet", "टीवी": "tv|television",
        "अलमारी": r"(?:\w+ )?cabinet|wardrobe|closet|cupboard",
        "दर्पण": "mirror", "आईन": "mirror", "शीशे": "mirror", "पौध": "plant", "बेंच": "bench",
        "नाइटस्टैंड": "nightstand|bedside", "बुकशेल्फ": "book|shel", "किताबों की": "book",
        "बाथटब": "bath|tub", "वॉशिंग मशीन": "wash", "वाशिंग मशीन": "wash", "कालीन": "rug|carpet|mat",
        "गलीचा": "rug|carpet|mat", "हीटर": "radiator|heat", "रेडिएटर": "radiator|heat",
        "पर्द": "curtain|drape", "लैंप": "lamp|light", "लैम्प": "lamp|light", "सिंक": "sink|basin",
        "वॉशबेसिन": "sink|basin", "कूड़ेदान": "bin|trash|garbage", "टोकरी": "basket|hamper",
        "काउंटर": "counter", "साइडबोर्ड": "sideboard|buffet", "ड्रेसर": "dresser|drawers",
        "जूतों": "shoe", "कोट": "coat", "तौलिय": "towel", "खिड़की": "window",
        "बच्चों का कमरा": "child|kid", "बच्चों के कमरे": "child|kid", "शॉवर": "shower",
        "पियानो": "piano", "सीढ़ी": "stair", "सीढ़ियों": "stair",
    },
}  # fmt: skip
