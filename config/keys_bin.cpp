// The keys of a bin: its floor, its book data, when it is measured and how the pictures become a volume.
#include <algorithm>

#include "config/keys.h"
#include "pipeline/types/bin_faults.h"

namespace granary {
namespace {

const Section<ScheduleOptions>& ScheduleSection() {
  using T = ScheduleOptions;
  static const Section<T> section = [] {
    auto every = Value<T>("every", &T::every, "", "Measures every so often. Either this or `at`.");
    every.print = [](const T& options) { return options.at.empty() ? PrintValue(options.every) : std::string(); };
    auto at = Value<T>("at", &T::at, "HH:MM", "Measures at these times of the day. Either this or `every`.")
                  .Allowed("different times, 00:00 to 23:59, e.g. [\"06:00\", \"18:00\"]")
                  .OmitEmpty();
    at.read = [inner = at.read](const Node& node, T& out) {
      inner(node, out);
      std::sort(out.at.begin(), out.at.end());
      if (const auto* array = node.toml.as_array(); array != nullptr && array->empty()) {
        node.Fault("is empty; must hold at least one time of the day, e.g. \"06:00\"");
      }
    };
    return Section<T>{{every, at, Value<T>("timezone", &T::timezone, "", "Time zone of `at`.")},
                      [](const T& options) { return Faults(options); }};
  }();
  return section;
}

Key<BinConfig> ScheduleKey() {
  auto key = InlineTable<BinConfig>("schedule", &BinConfig::schedule, ScheduleSection(), "When the bin is measured.");
  key.read = [inner = key.read](const Node& node, BinConfig& out) {
    inner(node, out);
    const toml::table* table = node.toml.as_table();
    if (table == nullptr || table->contains("every") != table->contains("at")) return;
    node.Fault(std::string("has ") + (table->contains("at") ? "both every and at" : "neither every nor at") +
               "; must be one of { every = \"30min\" } and { at = [\"06:00\"], timezone = \"Asia/Shanghai\" }");
  };
  return key;
}

const Section<Inventory>& InventorySection() {
  using T = Inventory;
  static const Section<T> section{
      {Value<T>("book_mass_kg", &T::book_mass_kg, "kg", "Quantity on the books. Unset: no error rate."),
       Value<T>("density_kg_m3", &T::density_kg_m3, "kg/m3", "Sampled bulk density. Unset: no quantity."),
       Value<T>("density_u95_percent", &T::density_u95_percent, "%",
                "Expanded uncertainty (k = 2) of density times correction. Unset: the error rate's uncertainty is the "
                "volume's alone."),
       Value<T>("correction", &T::correction, "", "Factor on the density for packing and moisture."),
       Value<T>("loss_kg", &T::loss_kg, "kg", "Estimated storage loss, added back to the quantity."),
       Value<T>("alarm_percent", &T::alarm_percent, "%", "An error rate beyond ± this is abnormal.")},
      [](const T& inventory) { return Faults(inventory); }};
  return section;
}

const Section<GrainKind>& GrainSection() {
  using T = GrainKind;
  static const Section<T> section{
      {Value<T>("name", &T::name, "", "For people, e.g. \"wheat\".").Allowed("any text"),
       Value<T>("surface_offset_m", &T::surface_offset_m, "m",
                "How far above the true height the cameras see the kernels' surface; taken off before the volume. "
                "`granaryctl grain-offset` finds it. Unset: nothing is taken off, and the uncertainty covers it."),
       Value<T>("surface_offset_u95_m", &T::surface_offset_u95_m, "m",
                "Expanded uncertainty (k = 2) of it. Unset: half of it."),
       Value<T>("angle_of_repose_deg", &T::angle_of_repose_deg, "degrees",
                "Steepest slope of a surface made up where nothing was seen. Unset: 45.")},
      [](const T& grain) { return Faults(grain); }};
  return section;
}

const Section<CycleOptions>& CycleSection() {
  using T = CycleOptions;
  static const Section<T> section{
      {Value<T>("attempts", &T::attempts, "", "Captures tried in a cycle before the last good value is held."),
       Value<T>("retry_delay", &T::retry_delay, "", "Pause between two of them."),
       Value<T>("max_rate_m3_h", &T::max_rate_m3_h, "m3/h",
                "A faster change of volume is implausible and retried. Unset: every change is believed."),
       Value<T>("stale_after", &T::stale_after, "",
                "Age at which a figure is marked stale. 0s: three times the schedule.")},
      [](const T& options) { return Faults(options); }};
  return section;
}

const Section<StereoOptions>& StereoSection() {
  using T = StereoOptions;
  static const Section<T> section{
      {Value<T>("census_width", &T::census_width, "px", "Width of the census window."),
       Value<T>("census_height", &T::census_height, "px", "Height of the census window."),
       Value<T>("p1", &T::p1, "census bits", "Penalty for a disparity step of one pixel."),
       Value<T>("p2", &T::p2, "census bits", "Penalty for a larger step."),
       Value<T>("adaptive_p2", &T::adaptive_p2, "",
                "Lowers p2 where the grey gradient along the path exceeds 20 of 255 levels, as the paper does."),
       Value<T>("median_px", &T::median_px, "px",
                "Window of the median over the winners of either picture; helps natural pictures. 0 leaves it out."),
       Value<T>("left_right_px", &T::left_right_px, "px", "Largest disagreement between left and right disparity."),
       Value<T>("uniqueness", &T::uniqueness, "", "Share by which the second-best match must be worse than the best."),
       Value<T>("speckle_area_px", &T::speckle_area_px, "px",
                "Connected patches of disparity smaller than this are removed. 0 keeps all."),
       Value<T>(
           "coarse_to_fine", &T::coarse_to_fine, "",
           "Searches near what pictures of half the size show: faster with many disparities, may miss thin things."),
       Value<T>("max_disparities", &T::max_disparities, "px",
                "Most disparities searched; limits how near to the cameras grain is seen."),
       Value<T>("refine_radius_px", &T::refine_radius_px, "px",
                "Half window of the least-squares refinement. 0 switches it off.")},
      [](const T& options) { return Faults(options); }};
  return section;
}

const Section<SurfaceOptions>& SurfaceSection() {
  using T = SurfaceOptions;
  static const Section<T> section{
      {Value<T>("segment_distance_m", &T::segment_distance_m, "m",
                "Points nearer to the empty bin than this are not grain. Unset: from the depth noise at the floor."),
       Value<T>("edge_threshold_m", &T::edge_threshold_m, "m",
                "Longest edge of a surface triangle. Unset: from the measured point spacing."),
       Value<T>("min_coverage", &T::min_coverage, "", "Share of the floor below which the figure is invalid."),
       Value<T>("reduced_coverage", &T::reduced_coverage, "",
                "Share of the floor below which the figure is marked as of reduced accuracy.")},
      [](const T& options) { return Faults(options); }};
  return section;
}

const Section<QualityOptions>& QualitySection() {
  using T = QualityOptions;
  static const Section<T> section{
      {Value<T>("min_mean_fraction", &T::min_mean_fraction, "",
                "Mean grey, as a share of full scale, that is too dark."),
       Value<T>("max_saturated_fraction", &T::max_saturated_fraction, "",
                "Share of fully white pixels inside the footprint that is too much."),
       Value<T>("min_speckle_contrast", &T::min_speckle_contrast, "",
                "Local standard deviation over local mean below which the speckle is taken as absent.")},
      [](const T& options) { return Faults(options); }};
  return section;
}

std::vector<std::string> BinFaults(const BinConfig& config) {
  std::vector<std::string> faults = Faults(config.bin);
  if (config.shots < 1 || config.shots > 20) faults.emplace_back("shots: must be 1 to 20");
  if (config.rigs.empty()) faults.emplace_back("rig: is missing; must be at least one [[bin.rig]]");
  for (std::size_t i = 0; i < config.rigs.size(); ++i) {
    const auto same_name = [&](const RigOptions& rig) { return rig.name == config.rigs[i].name; };
    if (std::any_of(config.rigs.begin(), config.rigs.begin() + static_cast<std::ptrdiff_t>(i), same_name)) {
      faults.push_back("rig[" + std::to_string(i) + "].name: is " + Quote(config.rigs[i].name) +
                       " like an earlier rig's; must be unique in the bin");
    }
  }
  return faults;
}

}  // namespace

const Section<BinConfig>& BinSection() {
  using T = BinConfig;
  const std::string polygon = "at least 3 corners in order around the floor, in metres";
  static const Section<T> section{
      {Value<T>(
           "id", [](auto& t) -> auto& { return t.bin.id; }, "", "The bin's number, also its Modbus unit id.")
           .Required(),
       Value<T>(
           "name", [](auto& t) -> auto& { return t.bin.name; }, "", "For people.")
           .Allowed("any text"),
       Value<T>(
           "footprint_m", [](auto& t) -> auto& { return t.bin.footprint_m; }, "m",
           "The polygon of the floor, world xy; the last corner joins the first.")
           .Required()
           .Allowed(polygon),
       Value<T>(
           "height_m", [](auto& t) -> auto& { return t.bin.height_m; }, "m",
           "Top of the bin above z = 0; points above it are no grain.")
           .Required(),
       Value<T>(
           "exclude_m", [](auto& t) -> auto& { return t.bin.exclude_m; }, "m",
           "Polygons on the floor that hold no grain (pillars, ducts); their column is no part of the volume.")
           .Allowed("polygons inside the footprint that do not overlap"),
       ScheduleKey(),
       Value<T>("shots", &T::shots, "",
                "Pairs of frames a rig that one measurement takes and fuses; with 2 or more, what moves is noticed.")
           .Allowed("1 to 20"),
       Table<T>(
           "grain", [](auto& t) -> auto& { return t.bin.grain; }, GrainSection(), "What lies in the bin."),
       Choice<T>(
           "book_source", &T::book_source,
           std::vector<std::pair<std::string, BookSource>>{{"registers", BookSource::kRegisters},
                                                           {"file", BookSource::kFile}},
           "Whose book data win: \"registers\", what a client committed last (registers 920 to 930, or the PLC), "
           "also after a restart, and the file's until then; \"file\": the file's, and nobody can commit others."),
       Table<T>("inventory", &T::inventory, InventorySection(), "Book data."),
       Table<T>("cycle", &T::cycle, CycleSection(), "Repeats and gates of one measuring cycle."),
       Table<T>(
           "stereo", [](auto& t) -> auto& { return t.pipeline.stereo; }, StereoSection(), "The stereo matcher."),
       Table<T>(
           "surface", [](auto& t) -> auto& { return t.pipeline.surface; }, SurfaceSection(),
           "From the cloud to the volume."),
       Table<T>(
           "quality", [](auto& t) -> auto& { return t.pipeline.quality; }, QualitySection(),
           "When a picture is too poor to be measured."),
       Tables<T>("rig", &T::rigs, RigSection(),
                 "One pair of cameras; at least one a bin. The clouds of several are fused.")},
      BinFaults};
  return section;
}

}  // namespace granary
