// granaryctl measure: one full measurement, printed and if wished saved with all its intermediates. It publishes
// nothing and stores no record.
#include <CLI/CLI.hpp>

#include <memory>
#include <optional>
#include <string>

#include "daemon/ctl/command.h"
#include "daemon/ctl/run.h"
#include "daemon/ctl/save_run.h"
#include "daemon/ctl/setup.h"
#include "daemon/ctl/summary.h"
#include "daemon/record_json.h"

namespace granary {
namespace {

struct MeasureArguments {
  FrameFiles files;
  std::optional<double> threshold_m;
  std::string rig;
  std::string save;
  bool budget = false;
};

int Measure(const GlobalOptions& global, const MeasureArguments& arguments) {
  ChosenBin bin = ChooseBin(global, arguments.rig);
  if (arguments.threshold_m) bin.config.pipeline.surface.edge_threshold_m = arguments.threshold_m;
  for (const std::string& fault : Faults(bin.config.pipeline.surface)) throw UsageError("--threshold: " + fault);

  const PipelineRun run = MeasureBin(bin, arguments.files);
  const Measurement& record = run.measurement;
  if (!arguments.save.empty()) SaveRun(arguments.save, bin, run);
  Say(Summary(record, bin.config.bin));
  if (arguments.budget && record.budget) Say(BudgetTable(record));
  if (global.json) PrintJson(RecordToJson(record));
  return record.valid ? kExitDone : kExitFailed;
}

}  // namespace

void AddMeasure(CLI::App& app, const GlobalOptions& global, Command& chosen) {
  const auto arguments = std::make_shared<MeasureArguments>();
  CLI::App* command = app.add_subcommand("measure", "one full measurement; never published");
  AddFrameOptions(*command, arguments->files, arguments->rig, "several times for several shots");
  command->add_option("--threshold", arguments->threshold_m, "longest edge of a triangle, metres")->type_name("M");
  command->add_flag("--budget", arguments->budget, "print what the uncertainty is made of, term by term");
  command->add_option("--save", arguments->save, "write every intermediate there")->type_name("DIR");
  command->callback([=, &global, &chosen] { chosen = [=, &global] { return Measure(global, *arguments); }; });
}

}  // namespace granary
