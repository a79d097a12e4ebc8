#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The tool l4dtrain from end to end: tool.sh L4DTRAIN L4DCODEC PYTHON. Works in a folder of its own.
set -euo pipefail

train=$1 codec=$2 python=$3
here=$(cd "$(dirname "$0")" && pwd)
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"

die() {
  echo "  $*" >&2
  exit 1
}
# wait_for WHAT COMMAND...: until the command succeeds. Long enough for a machine that has much else to do.
wait_for() {
  local what=$1 end=$((SECONDS + 120))
  shift
  until "$@"; do
    [ "$SECONDS" -lt "$end" ] || { cat ./*err >&2; die "still not after 120 s: $what"; }
    sleep 0.02
  done
}
has_checkpoint() { compgen -G "$1/checkpoint-*.l4dtrain" >found; }
# expect STATUS PATTERN ARGUMENTS...: runs l4dtrain; stderr or stdout matches the pattern.
expect() {
  local want=$1 pattern=$2 status=0
  shift 2
  "$train" "$@" >out 2>err || status=$?
  [ "$status" -eq "$want" ] || { cat out err >&2; die "l4dtrain $*: exit status $status, not $want"; }
  grep -Eq -- "$pattern" out err || { cat out err >&2; die "l4dtrain $*: nothing matches $pattern"; }
}

"$codec" synth --scene cloud --seconds 0.8 --fps 10 --gaussians 800 --seed 7 -o truth.ply --quiet
expect 0 "9 cameras" capture truth.ply -o capture --cameras 9 --size 48x40
expect 0 "cameras +9" inspect capture --sheet sheet.png
[ -s sheet.png ] || die "there is no contact sheet"
expect 0 '"layout": "cameras"' inspect capture --json

options=(capture --gaussians 300 --sh-degree 0 --views 2 --init frustum --exposure off)
expect 0 "Gaussians +[0-9]" train "${options[@]}" -o whole --steps 400 --watch -q
for name in preview.l4d scene.ply cameras.json settings.json log.jsonl curves.svg preview.png report.json report.html events.out.tfevents.l4dtrain; do
  [ -s "whole/$name" ] || die "$name is missing"
done
expect 0 "test +[0-9.]+ dB.*, [0-9.]+ JOD" eval whole -q --score all --jod --html jod.html
grep -q "<th>JOD</th>" jod.html || die "the page has no JOD"
# The cameras look at one place, so that nothing near to them is drawn, here and by other tools.
grep -q '"near": 0.2,' whole/settings.json || die "the near plane is not in the settings"
grep -Eq '"near": [0-9]*[.][0-9]' whole/cameras.json || die "cameras.json has no near plane"
! grep -q '"near": 0.0' whole/cameras.json || die "cameras see what is near to them"

# Nothing that is read is replaced.
before=$(cat capture/cameras.json whole/scene.ply | cksum)
expect 2 "the capture lies in this folder" train capture -o capture --steps 5 -q
expect 2 "the capture lies in this folder" train capture/cameras.json -o ./capture/ --steps 5 -q
expect 2 "lies in the folder of the run" train capture -o whole --force --init whole/scene.ply --steps 5 -q
expect 2 "there is already cameras.json" capture truth.ply -o capture --cameras 9 --size 48x40
for size in 33x24 64x47 33x25; do
  expect 2 "--size is $size; width and height of a video are even" capture truth.ply -o odd --format mp4 --size $size
  [ ! -e odd ] || die "a capture that is refused leaves a folder"
done
expect 0 "2 cameras" capture truth.ply -o odd --cameras 2 --frames 1 --size 33x25
# Cameras of a file, with their tests; and points on what the others see in the middle.
"$codec" synth --seconds 0.8 --fps 10 --gaussians 20000 -o square.ply --quiet
"$codec" cameras square.ply --grid 3x1 --size 40x30 -o rig.json -q
# What images do not show is not said of them: a lens, and times of its own.
sed -i '0,/"K":/s/"K":/"distortion": [0.1], "time_offset": 0.2, "lense": 1, "K":/' rig.json
"$python" - << 'END'
import json
rig = json.load(open("rig.json"))
for camera in rig["cameras"]:  # wide: of fewer an edge shows, and not the middle
    for k in range(2): camera["K"][k][k] *= 0.7
json.dump(rig, open("rig.json", "w"))
END
expect 0 "3 cameras" capture square.ply -o rig --cameras rig.json --frames 4 --points 50
for note in '"lense" of camera 0' "lens distorts, .* pinholes: 1" "a time_offset, .*: 1"; do
  grep -Eq "^note: .*$note" err || { cat err >&2; die "no note of $note"; }
done
expect 0 "test +cameras 1" inspect rig
! grep -Eq "distortion|time_offset" rig/cameras.json || die "a capture states a lens that its images do not have"
[ "$(sed -n 's/^element vertex //p' rig/points.ply)" = 50 ] || die "not 50 points"
"$python" - rig/points.ply rig/cameras.json << 'END'
import json, sys
rows = [[float(x) for x in line.split()] for line in open(sys.argv[1]).read().split("end_header\n")[1].splitlines()]
training = [c for c in json.load(open(sys.argv[2]))["cameras"] if c["split"] == "train"]
def sees(camera, point):
    u, v, w = (sum(r[k] * p for k, p in enumerate(point)) + r[3] for r in camera["w2c"][:3])
    k = camera["K"]
    return w > 0 and abs(k[0][0] * u / w) < 1.2 * k[0][2] and abs(k[1][1] * v / w) < 1.2 * k[1][2]
assert all(abs(row[-1] - 0.2) < 1e-6 for row in rows), rows
seen = sum(any(sees(camera, row[:3]) for camera in training) for row in rows)
assert len(training) == 2 and seen > 0.7 * len(rows), seen
END
expect 0 "" train rig --init rig/points.ply -o pointed --gaussians 100 --sh-degree 0 --steps 3
mkdir clouds && cp rig/points.ply clouds/0000.ply
expect 0 "" train rig --init clouds/ -o clouded --gaussians 100 --sh-degree 0 --steps 3
grep -qF "\"init\": \"$folder/clouds\"" clouded/settings.json || die "the folder of points is not named wherever one is"
expect 3 "cannot" capture truth.ply -o none --cameras none.json
[ "$(cat capture/cameras.json whole/scene.ply | cksum)" = "$before" ] || die "an input was replaced"

# A contact sheet is a .png, and no file of the capture under any name; it replaces an older one.
sums() { find capture truth.ply -type f -print0 | sort -z | xargs -0 cksum; }
sums >before
expect 2 "must end with .png" inspect capture --sheet capture/cameras.json
expect 2 "is a file of the capture" inspect capture --sheet capture/images/cam03/0004.png
expect 2 "is a file of the capture" inspect capture --frames 0:3 --sheet capture/images/cam03/0004.png
ln -s capture/cameras.json link.png
expect 2 "is a file of the capture" inspect capture --sheet link.png
ln capture/cameras.json hard.png
expect 2 "is a file of the capture" inspect capture --sheet hard.png
expect 0 "cameras +9" inspect capture --sheet sheet.png
expect 0 "cameras +9" inspect capture --sheet capture/sheet.png
expect 0 "cameras +9" inspect capture --sheet capture/sheet.png
rm link.png hard.png capture/sheet.png
expect 2 "there is a file of this name" capture truth.ply -o truth.ply
mkdir -p pictures/images/cam00
echo mine >pictures/images/cam00/0000.png
expect 2 "there is already images" capture truth.ply -o pictures --cameras 9 --size 48x40
[ "$(cat pictures/images/cam00/0000.png)" = mine ] || die "capture replaced an image"
sums | cmp before - || die "an input was replaced"

# What is killed goes on from its last checkpoint, and reaches the same bits.
"$train" train "${options[@]}" -o killed --steps 400 --checkpoint-every 0.1 -q >out 2>err &
pid=$!
wait_for "a checkpoint of killed" has_checkpoint killed
kill -9 "$pid" 2>/dev/null || true
wait "$pid" || true
# All options but --resume are those of the run, and it may be started from anywhere.
(cd / && "$train" train "$folder/capture/" -o "$folder/killed" --resume -q >"$folder/out")
grep -q "\"capture\": \"$(realpath capture)\"" killed/settings.json || die "settings.json has no absolute path"
(cd / && "$train" eval "$folder/whole" -q >"$folder/out") || die "eval needs the folder that training began in"
cmp whole/scene.ply killed/scene.ply || die "a run that was killed and resumed differs"

# What is asked to stop writes a checkpoint and says so.
"$train" train "${options[@]}" -o stopped --steps 400000 -q >out 2>err &
pid=$!
wait_for "the log of stopped" test -s stopped/log.jsonl
kill -TERM "$pid"
status=0
wait "$pid" || status=$?
[ "$status" -eq 130 ] || { cat err >&2; die "SIGTERM: exit status $status, not 130"; }
grep -q "resume" err || die "SIGTERM: nothing says how to go on"
has_checkpoint stopped || die "SIGTERM: there is no checkpoint"

# A folder that has something, and no run, is left as it is, also with --force.
mkdir foreign
for name in cameras.json scene.ply log.jsonl preview.png weights.ply scene.l4d; do echo "my $name" >"foreign/$name"; done
echo '{"capture": "of mine"}' >foreign/settings.json
cat foreign/* | cksum >before
for how in --tolerant --force; do
  expect 2 "something else than a run" train "${options[@]}" -o foreign --steps 5 $how -q
  expect 2 "something else than a run" train "${options[@]}" -o pictures --steps 5 $how -q
done
expect 3 "no checkpoint" train "${options[@]}" -o foreign --steps 5 --resume -q
cat foreign/* | cksum | cmp before - || die "a file of someone else was replaced"
[ "$(find foreign -mindepth 1 -maxdepth 1 | wc -l)" -eq 7 ] || die "a folder that is no run got files"

# One training at a time has a folder, and a terminal that goes away ends it as SIGTERM does.
# Under nohup, tests inherit that SIGHUP is ignored.
env --default-signal=HUP "$train" train "${options[@]}" -o busy --steps 400000 -q >out 2>busy.err &
pid=$!
wait_for "the log of busy" test -s busy/log.jsonl
kill -USR1 "$pid"
wait_for "the checkpoint of SIGUSR1" has_checkpoint busy
expect 2 "another training is at work" train "${options[@]}" -o busy --steps 400000 --force -q
expect 2 "another training is at work" train "${options[@]}" -o busy --steps 400000 --resume -q
[ -s busy/log.jsonl ] || die "a training that was refused removed files"
kill -HUP "$pid"
status=0
wait "$pid" || status=$?
[ "$status" -eq 130 ] || { cat busy.err >&2; die "SIGHUP: exit status $status, not 130"; }
grep -q "resume" busy.err || die "SIGHUP: nothing says how to go on"

# Images that are damaged when their window is read: the work so far is kept.
"$codec" synth --scene cloud --seconds 4 --fps 10 --gaussians 200 --seed 7 -o long.ply --quiet
expect 0 "4 cameras" capture long.ply -o late --cameras 4 --size 48x40
"$train" train late --gaussians 300 --sh-degree 0 --views 2 --init frustum --exposure off --host-memory 600k \
  -o late_run --steps 400000 -q >out 2>late.err &
pid=$!
wait_for "the log of late_run" test -s late_run/log.jsonl
cp -r late late_kept
cp -r late long_capture
for image in late/images/*/*.png; do printf 'no image' >"$image"; done
status=0
wait "$pid" || status=$?
[ "$status" -eq 4 ] || { cat late.err >&2; die "a damaged image: exit status $status, not 4"; }
grep -q "goes on from step" late.err || { cat late.err >&2; die "a damaged image: nothing says how to go on"; }
has_checkpoint late_run || die "a damaged image: there is no checkpoint"
at=$(sed -n 's/.*goes on from step \([0-9]*\).*/\1/p' late.err)
cp -r late_kept/. late
lines=$(wc -l <late_run/log.jsonl)
"$train" train late -o late_run --resume --accept-changes -q >out 2>late.err &
pid=$!
logs_more() { [ "$(wc -l <late_run/log.jsonl)" -gt "$lines" ]; }
wait_for "more of the log of late_run" logs_more
kill -TERM "$pid"
wait "$pid" || true
[ "$(sed -n 's/.*cancelled at step \([0-9]*\).*/\1/p' late.err)" -ge "$at" ] || {
  cat late.err >&2
  die "a damaged image: steps were lost"
}

# The hand-over to the encoder.
expect 0 "stream +[0-9]+ bytes" train "${options[@]}" -o coded --steps 60 --encode default -q
"$codec" validate coded/scene.l4d >out || die "the stream is not valid"
"$codec" encode coded/scene.ply --cameras coded/cameras.json -o again.l4d --quiet
cmp coded/scene.l4d again.l4d || die "l4dcodec encode --cameras makes another stream"
"$codec" info coded/scene.l4d >out
grep -q "^presentation: camera=" out || die "the stream states no first view"
# For a size in one number: the stream that the encoder's own target makes, of fewer Gaussians than were trained.
expect 0 "stream +[0-9]+ bytes" train "${options[@]}" -o sized --steps 60 --size 4kB -q
"$codec" encode sized/scene.ply --cameras sized/cameras.json --target-size 4kB -o again.l4d -f --quiet
cmp sized/scene.l4d again.l4d || die "--size makes another stream than --target-size"
[ "$(stat -c %s sized/scene.l4d)" -le 4000 ] || die "the stream is larger than --size"
expect 0 "stream +[0-9]+ bytes" train "${options[@]}" -o rated --steps 60 --bitrate 32kbit/s -q
[ "$(stat -c %s rated/scene.l4d)" -le 3200 ] || die "the stream is larger than --bitrate"
expect 0 "stream +[0-9]+ bytes" train "${options[@]}" -o rated --force --steps 60 --quality 30 -q
"$codec" encode rated/scene.ply --cameras rated/cameras.json --quality 30 -o again.l4d -f --quiet
cmp rated/scene.l4d again.l4d || die "--quality is not that of encode"
expect 5 'coded/scene.l4d: this is a stream, .*l4dcodec decode.* makes a PLY' capture coded/scene.l4d -o x

# LPIPS with weights of a file: random ones here. It is reported if it is wanted, and for equal images it is 0.
"$python" -B "$here/../../tests/common/random_alexnet.py" alex.safetensors
expect 0 "test +[0-9.]+ dB.*LPIPS .alex. 0[.][0-9]+" eval whole -q --lpips alex.safetensors
"$train" eval coded -q --json --lpips alex.safetensors >with.json
"$train" eval coded -q --json >without.json
expect 0 "LPIPS .alex." train "${options[@]}" -o scored --steps 60 --encode default -q --lpips alex.safetensors
"$python" - <<'END' || die "reports with and without --lpips are not as they should be"
import json
with_lpips, without = json.load(open("with.json")), json.load(open("without.json"))
scored = json.load(open("scored/report.json"))
for parts in (lambda r: r, lambda r: r["stream"]):
    for split in ("train", "test"):
        score = parts(with_lpips)[split]
        assert 0 < score["lpips_alex"] < 1, score
        assert abs(parts(scored)[split]["lpips_alex"] - score["lpips_alex"]) < 1e-4, (scored, score)
        assert "lpips_vgg" not in score, score
        del score["lpips_alex"]
        assert parts(without)[split] == score, score
assert "lpips" not in json.dumps(without)
END
head -c 3000 alex.safetensors >short.safetensors
expect 4 "data_offsets of features" eval whole -q --lpips short.safetensors
expect 3 "nowhere" eval whole -q --lpips nowhere.safetensors
expect 4 "no .safetensors file" train "${options[@]}" -o scored --force --steps 60 -q --lpips truth.ply
[ -s scored/report.json ] || die "a wrong file for --lpips removed the results of a run"
cp alex.safetensors scored/
expect 2 "--lpips lies in the folder" train "${options[@]}" -o scored --force --steps 60 -q --lpips scored/alex.safetensors
expect 2 "at least 31 pixels a side; these have 24 x 20" \
  train "${options[@]}" -o x --steps 10 --scale 0.5 --lpips alex.safetensors

# A verb that has no work to keep ends with the first signal.
"$train" capture long.ply -o endless --cameras 1000 --size 320x240 -q >out 2>err &
pid=$!
wait_for "an image of a capture" test -s endless/images/cam00/0000.png
kill -TERM "$pid"
status=0
wait "$pid" || status=$?
[ "$status" -eq 143 ] || die "capture: SIGTERM: exit status $status, not 143"
[ ! -e endless/cameras.json ] || die "capture: a capture that is not whole has a cameras.json"

# What cannot be done.
expect 2 "there is a run already" train "${options[@]}" -o whole --steps 400
cksum whole/settings.json >before
expect 2 'other settings: .*"steps 400", and now it is "steps 401"; .*"seed 0", and now it is "seed 9"' \
  train capture -o whole --steps 401 --seed 9 --resume
cksum whole/settings.json | cmp before - || die "a resume that was refused changed the settings"
cp -r capture kept
sed -i 's/"fps": 10/"fps": 20/' capture/cameras.json
expect 2 "the capture is not as it was" train capture -o whole --resume
cp kept/cameras.json capture/
cp capture/images/cam03/0005.png capture/images/cam03/0004.png
expect 2 "the capture is not as it was" train capture -o whole --resume
expect 0 "Gaussians" train capture -o whole --resume --accept-changes -q
expect 0 "Gaussians" train capture -o whole --resume -q
cp -r kept/. capture
expect 2 "the capture is not as it was" train capture -o whole --resume
rm -r kept
"$python" - <<'END' || die "report.json of a resumed run is not as it should be"
import json
whole, coded = json.load(open("whole/report.json")), json.load(open("coded/report.json"))
assert whole["total_s"] >= whole["training_s"], whole
assert coded["settings"]["preset"] == "default", coded
assert coded["devices"] == ([0] if coded["settings"]["backend"] == "cuda" else []), coded
assert "exchange" in coded["ms"] and sum(coded["ms"].values()) > 0, coded
END
expect 3 "no checkpoint" train "${options[@]}" -o none --steps 400 --resume
expect 2 "preset" train "${options[@]}" -o x --steps 10 --encode finest
expect 2 "exclude" train "${options[@]}" -o x --steps 10 --time 5
# What is wrong by itself is refused before anything is read.
expect 2 "--encode is finest" train nowhere -o x --size 1M --encode finest
expect 2 "--encode is finest" bench n3dv nowhere -o x --encode finest
expect 2 "the frames are" train nowhere -o x --frames 5:2
expect 2 "the test cameras are" train nowhere -o x --test 5-3
expect 2 "needs --backend cpu" train nowhere -o x --temporal-split on --backend cuda
expect 3 "--init is frustrum" train nowhere -o x --init frustrum
expect 2 "--codec is" train "${options[@]}" -o x --steps 10 --codec finest
expect 2 "needs --encode" train "${options[@]}" -o x --steps 10 --codec settle
for figure in 0 -3 101 nan much; do
  expect 2 "--stop-at" train "${options[@]}" -o x --stop-at $figure
done
expect 2 "--effort is" train "${options[@]}" -o x --effort much
expect 2 "must be positive" train "${options[@]}" -o x --steps 10 --size 0
expect 2 "--size: '2 pounds'" train "${options[@]}" -o x --steps 10 --size "2 pounds"
expect 2 "excludes" train "${options[@]}" -o x --steps 10 --size 1M --bitrate 1Mbit/s
expect 2 "--quality" train "${options[@]}" -o x --steps 10 --quality 10
expect 2 "nothing follows" train "${options[@]}" -o x --steps 10 --size 1M --encode lossless
expect 2 "need --codec prune" train "${options[@]}" -o x --steps 10 --size 1M --codec settle
expect 2 "--density-every" train "${options[@]}" -o x --steps 10 --density-every 7
expect 2 "--density is" train "${options[@]}" -o x --steps 10 --density more
expect 2 "--codec prune needs" train "${options[@]}" -o x --steps 10 --codec prune --density off
expect 2 "--devices is 0,x" train "${options[@]}" -o x --steps 10 --devices 0,x
expect 2 "--backend cpu uses no device" train "${options[@]}" -o x --steps 10 --devices 0 --backend cpu
expect 2 "--near" train "${options[@]}" -o x --steps 10 --near close
expect 2 "--max-scale" train "${options[@]}" -o x --steps 10 --max-scale 0
expect 2 "--opacity-weight" train "${options[@]}" -o x --steps 10 --opacity-weight -1
for value in 0 -1 nan inf; do
  for option in --seconds --fps --gaussians --steps --time --views --checkpoint-every; do
    expect 2 "$option: it is \"$value\"; it must be a number above 0" train capture -o x $option $value
  done
  expect 2 "--frames: it is" capture truth.ply -o x --frames $value
done
for option in --drift --error-weight --scale-weight --max-scale --opacity-weight --near \
  --entropy-weight --consistency-weight; do
  expect 2 "$option is .*; it must be" train "${options[@]}" -o x --steps 10 $option inf
done
expect 2 "--max-scale is .*; it must be" train "${options[@]}" -o x --steps 10 --max-scale 1e-30
expect 2 "--first is 8, and the scene has 8 frames" capture truth.ply -o x --first 8
expect 2 "ascending ranges" inspect capture --test 5-2
expect 2 "the frames are" inspect capture --frames 0:5:-1
expect 2 "the frames are" inspect capture --frames=-1:5
expect 0 "frames 3:100 end with the capture, which has 8" inspect capture --frames 3:100
expect 2 "--scale" train "${options[@]}" -o x --steps 10 --scale 2
expect 6 "windows" train "${options[@]}" -o x --steps 10 --host-memory 10k
expect 3 "nowhere" train nowhere -o x
[ ! -e x ] || die "a training that did not begin left a folder"
expect 3 "a file of this name" train "${options[@]}" -o truth.ply --steps 10
expect 5 "layout" inspect .
expect 2 "" train
for value in -1 1e30 99999999999999999999; do
  expect 2 "--seed: it is \"$value\"; it must be a whole number" train "${options[@]}" -o x --steps 10 --seed $value
  expect 2 "--threads: it is \"$value\"; it must be a whole number from 0 to 1024" inspect capture --threads $value
done
expect 2 "--scale is 1e-30; it makes images of 1 x 1 pixels" train "${options[@]}" -o x --steps 10 --scale 1e-30
expect 2 "--time is 1e[+]30; it must be at most" train "${options[@]}" -o x --time 1e30
expect 2 "--fps is 1e-30; it must be 0.001 to" inspect capture --fps 1e-30
expect 2 "--seconds is 1e[+]30; it must be 0.001 to" inspect capture --seconds 1e30
"$python" -B "$here/hostile_options.py" "$train" capture whole truth.ply || die "options out of range"

# What a capture names outside its folder: as for l4dcodec, read only where any path may be.
cp -r capture inner
for what in images mask; do
  "$python" - "$what" <<'PY'
import json, os, struct, sys, zlib
capture = json.load(open("capture/cameras.json"))
camera = capture["cameras"][1]
# Every other pixel counts.
size = [camera.get(side, capture.get(side)) for side in ("width", "height")]
rows = zlib.compress((b"\0" + bytes(255 * (x % 2) for x in range(size[0]))) * size[1])
with open("mask.png", "wb") as mask:
    mask.write(b"\x89PNG\r\n\x1a\n")
    for name, data in (b"IHDR", struct.pack(">2I5B", *size, 8, 0, 0, 0, 0)), (b"IDAT", rows), (b"IEND", b""):
        mask.write(struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data)))
outside = {"images": "../capture/" + camera["images"], "mask": os.path.abspath("mask.png")}
camera[sys.argv[1]] = outside[sys.argv[1]]
json.dump(capture, open("inner/cameras.json", "w"))
PY
  expect 2 "camera 1: .* is not in the folder of the cameras; --any-path" inspect inner
  expect 2 "camera 1: .* is not in the folder of the cameras; --any-path" \
    train inner "${options[@]:1}" -o x --steps 10
  expect 0 "cameras +9" inspect inner --any-path
done
expect 0 "Gaussians" train inner "${options[@]:1}" -o elsewhere --steps 10 -q --any-path
expect 0 "test +[0-9.]+ dB" eval elsewhere -q
# Cameras that are none.
for change in '["near"]=1e300' '["time_offset"]=1e300' '["w2c"][0][3]=1e300' '["K"][0][0]=1e300' '["distortion"]=[1e30]*8'; do
  "$python" -c 'import json, sys
capture = json.load(open("capture/cameras.json"))
exec("capture[\"cameras\"][2]" + sys.argv[1])
json.dump(capture, open("inner/cameras.json", "w"))' "$change"
  expect 4 "inner/cameras.json: camera 2: .* is 1e[+]30" inspect inner
done

# A cache: refused before anything is written, and a note where there is nothing to keep.
expect 3 "truth.ply: --cache is a file; it must be a folder" train "${options[@]}" -o x --steps 10 --cache truth.ply
expect 2 "--cache lies in the folder of the run" train "${options[@]}" -o x --steps 10 --cache x/cache
expect 2 "--cache-limit" train "${options[@]}" -o x --steps 10 --cache cache --cache-limit much
[ ! -e x ] || die "a training that was refused for its cache left a folder"
[ ! -e cache ] || die "a training that was refused for its cache made one"
expect 0 "The capture has no videos" train "${options[@]}" -o cacheless --steps 10 --cache cache
[ ! -e cache ] || die "images went into a cache"
expect 0 "cache      none of this capture" inspect capture --cache cache

# A limit of memory: what it is for is named before anything is written, and images make way.
expect 6 "needs .*, and --limit-memory is 1.0 MB: Gaussians .* rendering .* images .* scores" \
  train "${options[@]}" -o x --steps 10 --limit-memory 1M
expect 6 "the network of --lpips needs" train "${options[@]}" -o x --steps 10 --limit-memory 100k --lpips alex.safetensors
expect 2 "--device-memory must be positive" train "${options[@]}" -o x --steps 10 --device-memory 0
expect 2 "--limit-memory must be positive" train "${options[@]}" -o x --steps 10 --limit-memory 0
[ ! -e x ] || die "a training that was refused for its memory left a folder"
tight=(long_capture --gaussians 300 --sh-degree 0 --views 2 --init frustum --exposure off --threads 1 --steps 40 --limit-memory 2600k
  --backend cpu -q)
expect 0 "Gaussians" train "${tight[@]}" -o limited
grep -q '"host_memory": [0-9]\{6\},' limited/settings.json || die "images did not make way for the limit"
expect 6 "needs 2[.]8 MB" train "${tight[@]}" -o x --host-memory 8G

# Output that is not taken: a status, a message, and nothing that was there is lost.
for verb in "inspect capture --json" "eval whole -q --json" "train --help"; do
  status=0
  # shellcheck disable=SC2086
  "$train" $verb >/dev/full 2>err || status=$?
  [ "$status" -eq 3 ] || { cat err >&2; die "$verb to a full device: exit status $status, not 3"; }
  grep -q "cannot write to the standard output: No space" err || { cat err >&2; die "$verb to a full device: no reason"; }
done
# Files of at most 40 kB, as a disk that fills up while a checkpoint is written.
status=0
(
  ulimit -f 40
  "$train" train "${options[@]}" -o full --steps 40000 --checkpoint-every 0.2 -q >out 2>err
) || status=$?
[ "$status" -eq 3 ] || { cat err >&2; die "a full disk: exit status $status, not 3"; }
grep -Eq "File too large.*no checkpoint to resume from" err || { cat err >&2; die "a full disk: no reason"; }
[ -z "$(find full -size +40k)" ] || die "a full disk: a file is larger than what fits"
rm -r full
"$train" train "${options[@]}" -o full --steps 400 -q >out
status=0
(
  ulimit -f 8
  "$train" train "${options[@]}" -o full --resume -q >out 2>err
) || status=$?
[ "$status" -eq 3 ] || { cat err >&2; die "a full disk at the end: exit status $status, not 3"; }
"$train" train "${options[@]}" -o full --resume -q >out || die "a full disk: the run does not go on"
cmp whole/scene.ply full/scene.ply || die "a full disk: the run ends in other bits"

mv capture/images/cam03/0004.png kept.png
expect 3 "camera 3" train "${options[@]}" -o x --steps 10
printf 'no image' >capture/images/cam03/0004.png
expect 4 "camera 3, frame 4" train "${options[@]}" -o x --steps 10
mv kept.png capture/images/cam03/0004.png
echo "passed"
