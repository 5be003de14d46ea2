# The kernel's simulated devices: a camera that can be unplugged (vivid), cameras that show what they are fed
# (v4l2loopback), and a GPIO chip whose lines can be looked at from outside (gpio-sim).

modprobe vivid n_devs=1 node_types=0x1 num_inputs=1 input_types=0
modprobe v4l2loopback devices=2 video_nr=40,41 card_label=granary-left,granary-right exclusive_caps=0,0 max_buffers=8

modprobe gpio-sim
mountpoint -q /sys/kernel/config || mount -t configfs configfs /sys/kernel/config
gpio=/sys/kernel/config/gpio-sim/granary
mkdir -p $gpio/bank0/line3 $gpio/bank0/line5
echo 8 >$gpio/bank0/num_lines
echo granary-rig >$gpio/bank0/label
echo PROJECTOR >$gpio/bank0/line3/name
echo TRIGGER >$gpio/bank0/line5/name
# Plugs the chip in and finds it: its number may be another one each time.
plug_chip() {
  echo 1 >$gpio/live
  chip=$(cat $gpio/bank0/chip_name)
  lines=/sys/devices/platform/$(cat $gpio/dev_name)/$chip
  light=$lines/sim_gpio3/value
}
plug_chip

# The rights that the package installs, before the first udev event of these devices is over.
systemd-sysusers /opt/granary/systemd/sysusers.conf
systemd-tmpfiles --create /opt/granary/systemd/tmpfiles.conf
install -m644 /opt/granary/systemd/udev.rules /etc/udev/rules.d/60-granaryd.rules
udevadm control --reload
udevadm trigger --subsystem-match=gpio --settle
udevadm settle

vivid_node=/dev/v4l/by-path/platform-vivid.0-video-index0
check "vivid's camera is there, named by path" test -e $vivid_node
check "two loopback cameras are there" test -c /dev/video40 -a -c /dev/video41
check "a GPIO chip is there, its projector line low" grep -q 0 "$light"
trace_on
