"""Names and numbers of keys, as in the kernel's linux/input-event-codes.h.

Keys that are missing here can be given by number.
"""

MAX_CODE = 0x2FF

_RUNS = {
    1: "ESC 1 2 3 4 5 6 7 8 9 0 MINUS EQUAL BACKSPACE TAB Q W E R T Y U I O P",
    26: "LEFTBRACE RIGHTBRACE ENTER LEFTCTRL A S D F G H J K L SEMICOLON APOSTROPHE",
    41: "GRAVE LEFTSHIFT BACKSLASH Z X C V B N M COMMA DOT SLASH RIGHTSHIFT",
    55: "KPASTERISK LEFTALT SPACE CAPSLOCK F1 F2 F3 F4 F5 F6 F7 F8 F9 F10",
    69: "NUMLOCK SCROLLLOCK KP7 KP8 KP9 KPMINUS KP4 KP5 KP6 KPPLUS KP1 KP2 KP3 KP0",
    83: "KPDOT",
    87: "F11 F12",
    96: "KPENTER RIGHTCTRL KPSLASH",
    100: "RIGHTALT",
    102: "HOME UP PAGEUP LEFT RIGHT END DOWN PAGEDOWN INSERT DELETE",
    113: "MUTE VOLUMEDOWN VOLUMEUP",
    164: "PLAYPAUSE",
}
_BUTTONS = {
    0x100: "0 1 2 3 4 5 6 7 8 9",
    0x110: "LEFT RIGHT MIDDLE SIDE EXTRA",
    0x120: "TRIGGER THUMB",
    0x130: "SOUTH EAST",
}

KEY_CODES = {
    f"{prefix}_{name}": first + number
    for prefix, runs in (("KEY", _RUNS), ("BTN", _BUTTONS))
    for first, names in runs.items()
    for number, name in enumerate(names.split())
}
