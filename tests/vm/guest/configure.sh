# configure LEFT_TRIGGER RIGHT_CAMERA RIGHT_TRIGGER: writes the daemon's configuration.
# exposure_us: these cameras cannot be told; it makes the pulse of triggered ones long enough for a feeder that is late.
# max_skew_us: the feeder writes the left picture before the right one, and emulated that takes some milliseconds.
# settle_us: as long as the feeder needs to notice the light. max_on_ms: several of its exposures fall inside, but fewer
# than there are buffers: v4l2loopback skips to the newest picture when its reader falls further behind.
configure() {
  mkdir -p /etc/granaryd
  cat >/etc/granaryd/granaryd.toml <<END
[site]
name = "vm"
[[bin]]
id = 1
name = "bay-1"
footprint_m = [[0.0, 0.0], [0.52, 0.0], [0.52, 0.355], [0.0, 0.355]]
height_m = 0.285
schedule = { every = "3s" }
[bin.cycle]
retry_delay = "200ms"
stale_after = "10min"
[[bin.rig]]
name = "a"
calibration = "/opt/granary/frames/stereo.yml"
pose = "/opt/granary/frames/world.yml"
max_skew_us = 50000
warmup_pairs = 0
exposure_brackets = 0
left = { driver = "v4l2", id = "/dev/video40", trigger = "$1", pixel_format = "GREY", exposure_us = 100000 }
right = { driver = "v4l2", id = "$2", trigger = "$3", pixel_format = "GREY", exposure_us = 100000 }
projector = { driver = "gpio", chip = "granary-rig", line = 3, settle_us = 20000, max_on_ms = 300, max_duty_percent = 100 }
END
}
