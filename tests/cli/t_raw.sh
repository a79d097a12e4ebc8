# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Raw arrays say what they are, and come back in as the same scene.
l4d synth -n 500 --seconds 2 --scene cloud -o s.ply -q
l4d encode s.ply -o s.l4d --preset lossless -q --rendering dilation=0.1 --presentation playback=loop
expect 0 decode s.l4d --format raw -o a.safetensors
"$PYTHON" - <<'PY'
import json
data = open("a.safetensors", "rb").read()
m = json.loads(data[8:8 + int.from_bytes(data[:8], "little")])["__metadata__"]
assert m["time_unit"] == "seconds" and m["time_begin"] == "0" and m["num_frames"] == "60", m
assert m["fps"] == "30" and m["position_at"] == "mean_time" and m["opacity"] == "logit", m
assert "dilation=0.1" in m["l4d_rendering"] and "playback=loop" in m["l4d_presentation"], m
PY
expect 0 encode a.safetensors -o b.l4d --preset lossless
expect_document 0 compare s.l4d b.l4d
expect_json out 'd["identical"]'
expect 0 decode b.l4d --format raw -o b.safetensors
cmp a.safetensors b.safetensors || die 'raw arrays changed on the way'

# Arrays that are no scene are refused by name.
"$PYTHON" - <<'PY'
import json
def write(name, change):
    data = open("a.safetensors", "rb").read()
    n = int.from_bytes(data[:8], "little")
    header = json.loads(data[8:8 + n])
    change(header)
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    open(name, "wb").write(len(text).to_bytes(8, "little") + text + data[8 + n:])
def without_schema(h): del h["__metadata__"]["schema"]
def other_schema(h): h["__metadata__"]["schema"] = "other"
def packed(h): h["__metadata__"]["form"] = "packed"
def flags(h): h["__metadata__"]["flags"] = "64"
def frames(h): h["__metadata__"]["num_frames"] = "99999999"
def order(h): h["__metadata__"]["byte_order"] = "big"
def logits(h): h["__metadata__"]["opacity"] = "linear"
def count(h): h["__metadata__"]["num_gaussians"] = "1"
def huge(h): h["mean_t"]["shape"] = h["mean_t_exact"]["shape"] = [1 << 40]
def more(h): h["labels"] = h["opacity"]
def no_clock(h):
    for key in ("num_frames", "fps", "time_begin", "time_end"): h["__metadata__"].pop(key, None)
def unit(h): h["__metadata__"]["time_unit"] = "milliseconds"
def end(h): h["__metadata__"]["time_end"] = "9"
def only_end(h):
    del h["__metadata__"]["num_frames"]
    h["__metadata__"].update(time_end="3", frame_rate="25")
def rate(h): h["__metadata__"]["fps"] = 25
for change in (without_schema, other_schema, packed, flags, frames, order, logits, count, huge, more, no_clock, unit, end, only_end, rate):
    write(change.__name__ + ".safetensors", change)
PY
refused() { expect "$2" info "$1.safetensors"; expect_text err "$3"; }
refused without_schema 5 'lack .schema.*docs/formats.md'
refused other_schema 5 'must be l4dcodec.raw/1'
refused packed 5 'codebooks'
refused flags 4 'flags of the metadata'
refused frames 4 'num_frames of the metadata'
refused order 4 "byte_order of the metadata is 'big'.*little"
refused logits 4 "opacity of the metadata is 'linear'.*logit"
refused count 4 "num_gaussians of the metadata is '1'"
refused huge 4 'shape'
expect_document 0 info more.safetensors
expect_json out 'any("1 array was not read: labels." == n for n in d["notes"])'
expect 0 encode no_clock.safetensors --seconds 3 --preset lossless -o n.l4d
expect_text err 'no timeline; 3 seconds'
refused unit 5 'time_unit is not seconds'
refused end 4 '2 seconds, time_begin and time_end are 9'
refused rate 4 'fps of __metadata__ is no text'
expect_document 0 info only_end.safetensors
expect_json out 'any("frame_rate are not known" in n for n in d["notes"])'
expect 0 encode only_end.safetensors --seconds 9 --fps 5 --preset lossless -o n.l4d -f
expect_text err '--fps 5 is not used: the file states a frame rate of 30'
expect_text err '--seconds 9 is not used: the file states a duration in seconds of 3'
expect_document 0 info n.l4d
expect_json out 'd["num_frames"] == 90'
expect 6 info a.safetensors --limit-memory 10k
