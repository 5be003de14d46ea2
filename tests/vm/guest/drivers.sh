# The drivers by themselves.
export GRANARY_CHIP=/dev/$chip GRANARY_LINES=$lines
run_tests vm_camera_test
run_tests vm_projector_test
