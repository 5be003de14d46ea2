// What units do for those who write, and for those who may not.
#include <cmath>
#include <limits>
#include <memory>
#include <sstream>
#include <string>

#include <spdlog/sinks/ostream_sink.h>
#include <spdlog/spdlog.h>

#include "tests/daemon/modbus/units_fixture.h"

namespace granary {
namespace {

using namespace std::chrono_literals;
using test::ReadPdu;
using test::Words;
using test::WriteManyPdu;
using test::WritePdu;

const Pdu kEveryWrite[] = {WritePdu(48, 0xFF00, 5), WritePdu(910, 1),         {15, 0, 48, 0, 1, 1, 1},
                           WriteManyPdu(900, {1}),  {22, 3, 132, 0, 0, 0, 1}, {23, 0, 0, 0, 1, 3, 132, 0, 1, 2, 0, 1}};

constexpr const char* kOther = "192.168.7.21:40112";

class ModbusUnitsWriteTest : public test::UnitsTest {
 protected:
  bool NothingWasAsked() const {
    return control_.asked().empty() && control_.committed().empty() && control_.chosen().empty();
  }
  Words Book(float mass_t, float density, float correction, float loss_t) const {
    Words words;
    for (const float value : {mass_t, density, correction, loss_t}) test::AppendF32(value, words);
    return words;
  }
  Words WholeBook(float mass_t, float density, float correction, float loss_t) const {
    Words words = Book(mass_t, density, correction, loss_t);
    words.insert(words.end(), {0, 0, 1});
    return words;
  }
};

TEST_F(ModbusUnitsWriteTest, WhoMayNotWriteGetsIllegalFunctionAndIsCounted) {
  for (const Pdu& request : kEveryWrite) {
    EXPECT_EQ(AskAsReader(request), (Pdu{static_cast<std::uint8_t>(request[0] | 0x80), 1})) << int{request[0]};
  }
  EXPECT_TRUE(NothingWasAsked());
  EXPECT_EQ(tally_.Read().writes_refused, 6U);
  EXPECT_EQ(tally_.Read().writes, 0U);
}

TEST_F(ModbusUnitsWriteTest, WhoMayNotWriteStagesNothing) {
  EXPECT_EQ(AskAsReader(WriteManyPdu(920, Book(16, 800, 1, 0))), (Pdu{0x90, 1}));
  EXPECT_EQ(ReadF32(920), 15.2F);
  EXPECT_EQ(ReadOne(930), 0);
}

TEST_F(ModbusUnitsWriteTest, RefusedWritesAreOneLogLineAMinute) {
  const auto before = spdlog::default_logger();
  std::ostringstream log;
  spdlog::set_default_logger(
      std::make_shared<spdlog::logger>("test", std::make_shared<spdlog::sinks::ostream_sink_mt>(log)));
  spdlog::default_logger()->set_pattern("%v");
  for (int i = 0; i < 3; ++i) AskAsReader(WritePdu(910, 1));
  EXPECT_EQ(log.str(),
            "modbus: 192.168.7.99:50000 may not write (see write_allow): function 6, address 910; refused (1 since the "
            "last such line)\n");
  steady_ += 61s;
  log.str("");
  AskAsReader({23, 0, 0, 0, 1, 3, 132, 0, 1, 2, 0, 1});
  AskAsReader({6});
  EXPECT_EQ(log.str(),
            "modbus: 192.168.7.99:50000 may not write (see write_allow): function 23, address 900; refused (3 since "
            "the last such line)\n");
  spdlog::set_default_logger(before);
}

TEST_F(ModbusUnitsWriteTest, RepliesAreThoseOfTheStandard) {
  EXPECT_EQ(Ask(kEveryWrite[0]), kEveryWrite[0]);
  EXPECT_EQ(Ask(kEveryWrite[1]), kEveryWrite[1]);
  EXPECT_EQ(Ask(kEveryWrite[2]), (Pdu{15, 0, 48, 0, 1}));
  EXPECT_EQ(Ask(kEveryWrite[3]), (Pdu{16, 3, 132, 0, 1}));
  EXPECT_EQ(Ask(kEveryWrite[4]), kEveryWrite[4]);
  EXPECT_EQ(Ask(kEveryWrite[5]), (Pdu{23, 2, 0, 1}));
  EXPECT_EQ(tally_.Read().writes, 6U);
}

TEST_F(ModbusUnitsWriteTest, CommandIsAskedInTheClientsName) {
  Ask(WritePdu(910, 3));
  ASSERT_EQ(control_.asked().size(), 1U);
  EXPECT_EQ(control_.asked()[0].bin, 3);
  EXPECT_EQ(control_.asked()[0].command, BinCommand::kInhibit);
  EXPECT_EQ(control_.asked()[0].who, "192.168.7.20:40112");
}

TEST_F(ModbusUnitsWriteTest, CoilsAskForTheirCommands) {
  Ask(WritePdu(48, 0xFF00, 5));
  Ask(WritePdu(49, 0xFF00, 5));
  Ask(WritePdu(50, 0xFF00, 5));
  Ask(WritePdu(50, 0x0000, 5));
  const auto asked = control_.asked();
  ASSERT_EQ(asked.size(), 4U);
  EXPECT_EQ(asked[0].command, BinCommand::kMeasure);
  EXPECT_EQ(asked[1].command, BinCommand::kAcknowledge);
  EXPECT_EQ(asked[2].command, BinCommand::kInhibit);
  EXPECT_EQ(asked[3].command, BinCommand::kRelease);
}

TEST_F(ModbusUnitsWriteTest, MomentaryCoilSwitchedOffIsAcceptedAndDoesNothing) {
  EXPECT_EQ(Ask(WritePdu(48, 0, 5)), WritePdu(48, 0, 5));
  EXPECT_TRUE(NothingWasAsked());
}

TEST_F(ModbusUnitsWriteTest, BusyBinIsExceptionSixAndNoWrite) {
  control_.ready = false;
  EXPECT_EQ(Ask(WritePdu(910, 1)), (Pdu{0x86, 6}));
  EXPECT_EQ(Ask(WritePdu(900, 1)), (Pdu{0x86, 6}));
  EXPECT_EQ(Ask(WriteManyPdu(920, WholeBook(16, 800, 1, 0))), (Pdu{0x90, 6}));
  EXPECT_EQ(tally_.Read().writes, 0U);
}

TEST_F(ModbusUnitsWriteTest, FormatIsHandedToTheControl) {
  Ask(WriteManyPdu(900, {3, 2}));
  ASSERT_EQ(control_.chosen().size(), 1U);
  EXPECT_EQ(control_.chosen()[0].format, (RegisterFormat{ByteOrder::kBadc, InvalidPolicy::kMinus9999}));
  EXPECT_EQ(ReadOne(900), 0) << "what is in force is what the snapshot says";
}

TEST_F(ModbusUnitsWriteTest, ReadWriteReadsWhatItWrote) {
  const Pdu reply = Ask({23, 3, 152, 0, 2, 3, 152, 0, 2, 4, 0x41, 0x80, 0, 0});
  EXPECT_EQ(reply, (Pdu{23, 4, 0x41, 0x80, 0, 0}));
}

TEST_F(ModbusUnitsWriteTest, ReadWriteWithABadHalfDoesNothing) {
  EXPECT_EQ(Ask({23, 0x0F, 0xA0, 0, 1, 3, 132, 0, 1, 2, 0, 1}), (Pdu{0x97, 2}));
  EXPECT_EQ(Ask({23, 0, 0, 0, 126, 3, 132, 0, 1, 2, 0, 1}), (Pdu{0x97, 3}));
  EXPECT_EQ(Ask({23, 0, 0, 0, 1, 0, 0, 0, 1, 2, 0, 1}), (Pdu{0x97, 2}));
  EXPECT_TRUE(NothingWasAsked());
}

TEST_F(ModbusUnitsWriteTest, WriteThatIsWrongAnywhereChangesNothing) {
  EXPECT_EQ(Ask(WriteManyPdu(900, {1, 7})), (Pdu{0x90, 3}));
  EXPECT_EQ(Ask(WriteManyPdu(926, {0x3F80, 0, 5})), (Pdu{0x90, 3}));
  EXPECT_TRUE(NothingWasAsked());
  EXPECT_EQ(ReadOne(930), 0);
  EXPECT_EQ(ReadF32(926), 0.012F);
}

TEST_F(ModbusUnitsWriteTest, StagedBookDataReadBackAndAreNotCommitted) {
  EXPECT_EQ(Ask(WriteManyPdu(920, {0x4180, 0})), (Pdu{16, 3, 152, 0, 2}));
  EXPECT_EQ(ReadF32(920), 16.0F);
  EXPECT_EQ(ReadF32(922), 790.0F);
  EXPECT_EQ(ReadOne(930), 1);
  EXPECT_TRUE(NothingWasAsked());
}

TEST_F(ModbusUnitsWriteTest, CommitTakesStagedFiguresAndThoseInForce) {
  Ask(WritePdu(920, 0x4180));
  Ask(WritePdu(921, 0));
  EXPECT_EQ(Ask(WritePdu(930, 1)), WritePdu(930, 1));
  ASSERT_EQ(control_.committed().size(), 1U);
  EXPECT_EQ(control_.committed()[0].bin, 3);
  EXPECT_EQ(control_.committed()[0].who, "192.168.7.20:40112");
  EXPECT_EQ(control_.committed()[0].book,
            (BookData{.book_mass_kg = 16000, .density_kg_m3 = 790, .correction = 1, .loss_kg = 12}));
  EXPECT_EQ(ReadOne(930), 0);
}

TEST_F(ModbusUnitsWriteTest, OneRequestStagesAndCommits) {
  EXPECT_EQ(Ask(WriteManyPdu(920, WholeBook(16, 800, 1.25F, 0.5F))), (Pdu{16, 3, 152, 0, 11}));
  ASSERT_EQ(control_.committed().size(), 1U);
  EXPECT_EQ(control_.committed()[0].book,
            (BookData{.book_mass_kg = 16000, .density_kg_m3 = 800, .correction = 1.25, .loss_kg = 500}));
}

TEST_F(ModbusUnitsWriteTest, BookDataOutOfRangeAreRefusedAndForgotten) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (const auto& book : {WholeBook(16, -1, 1, 0), WholeBook(nan, 800, 1, 0), WholeBook(16, 800, INFINITY, 0)}) {
    EXPECT_EQ(Ask(WriteManyPdu(920, book)), (Pdu{0x90, 3}));
  }
  Ask(WriteManyPdu(922, {0xBF80, 0}));  // −1 kg/m³
  EXPECT_EQ(Ask(WritePdu(930, 1)), (Pdu{0x86, 3}));
  EXPECT_TRUE(NothingWasAsked());
  EXPECT_EQ(ReadF32(922), 790.0F);
  EXPECT_EQ(ReadOne(930), 0);
}

TEST_F(ModbusUnitsWriteTest, HalfAFigureIsNotCommitted) {
  Ask(WritePdu(920, 0x4180));
  EXPECT_EQ(Ask(WritePdu(930, 1)), (Pdu{0x86, 3}));
  EXPECT_TRUE(NothingWasAsked());
}

TEST_F(ModbusUnitsWriteTest, CommitOfNothingIsRefused) {
  EXPECT_EQ(Ask(WritePdu(930, 1)), (Pdu{0x86, 3}));
  EXPECT_TRUE(NothingWasAsked());
}

TEST_F(ModbusUnitsWriteTest, UnknownFigureMustBeWrittenBeforeACommit) {
  snapshot_.book.in_force.density_kg_m3.reset();
  units_.Publish(snapshot_);
  EXPECT_TRUE(std::isnan(ReadF32(922)));
  Ask(WriteManyPdu(920, {0x4180, 0}));
  EXPECT_EQ(Ask(WritePdu(930, 1)), (Pdu{0x86, 3}));
  Ask(WriteManyPdu(920, {0x4180, 0, 0x4448, 0}));  // 800 kg/m³
  EXPECT_EQ(Ask(WritePdu(930, 1)), WritePdu(930, 1));
}

TEST_F(ModbusUnitsWriteTest, StagedDataAreTheirHostsForAMinute) {
  Ask(WriteManyPdu(920, {0x4180, 0}));
  steady_ += 59s;
  EXPECT_EQ(Ask(WritePdu(922, 0x4448), kOther), (Pdu{0x86, 6}));
  EXPECT_EQ(Ask(WritePdu(930, 1), kOther), (Pdu{0x86, 6}));
  EXPECT_EQ(Ask(WriteManyPdu(922, {0x4448, 0}), "192.168.7.20:51000"), (Pdu{16, 3, 154, 0, 2}))
      << "the same host on another connection";
  EXPECT_TRUE(NothingWasAsked());
}

TEST_F(ModbusUnitsWriteTest, StagedDataAreForgottenAfterAMinute) {
  Ask(WriteManyPdu(920, {0x4180, 0}));
  steady_ += 60s;
  EXPECT_EQ(ReadF32(920), 15.2F);
  EXPECT_EQ(ReadOne(930), 0);
  EXPECT_EQ(Ask(WritePdu(930, 1)), (Pdu{0x86, 3}));
  EXPECT_EQ(Ask(WriteManyPdu(922, {0x4448, 0}), kOther), (Pdu{16, 3, 154, 0, 2}));
}

TEST_F(ModbusUnitsWriteTest, EveryStagedWordStartsTheMinuteAnew) {
  Ask(WriteManyPdu(920, {0x4180, 0}));
  steady_ += 50s;
  Ask(WriteManyPdu(922, {0x4448, 0}));
  steady_ += 50s;
  EXPECT_EQ(Ask(WritePdu(930, 1)), WritePdu(930, 1));
}

TEST_F(ModbusUnitsWriteTest, StagedDataOutliveAPublication) {
  Ask(WriteManyPdu(920, {0x4180, 0}));
  snapshot_.heartbeat = 42;
  units_.Publish(snapshot_);
  EXPECT_EQ(ReadF32(920), 16.0F);
  EXPECT_EQ(ReadOne(930), 1);
}

TEST_F(ModbusUnitsWriteTest, CommitThatIsNotTakenLeavesTheStageAsItWas) {
  Ask(WriteManyPdu(920, {0x4180, 0}));
  control_.ready = false;
  EXPECT_EQ(Ask(WriteManyPdu(922, {0x4448, 0, 0x3F80, 0, 0, 0, 0, 0, 1})), (Pdu{0x90, 6}));
  EXPECT_EQ(ReadF32(920), 16.0F);
  EXPECT_EQ(ReadF32(922), 790.0F);
  control_.ready = true;
  EXPECT_EQ(Ask(WritePdu(930, 1)), WritePdu(930, 1));
}

TEST_F(ModbusUnitsWriteTest, NothingIsStagedWhileACommitIsBusy) {
  snapshot_.book.commit = CommandResult::kBusy;
  units_.Publish(snapshot_);
  EXPECT_EQ(Ask(WriteManyPdu(920, {0x4180, 0})), (Pdu{0x90, 6}));
  EXPECT_EQ(ReadOne(930), 1);
}

TEST_F(ModbusUnitsWriteTest, BookOfTheConfigurationIsNotWritable) {
  snapshot_.book.writable = false;
  units_.Publish(snapshot_);
  EXPECT_EQ(Ask(WriteManyPdu(920, WholeBook(16, 800, 1, 0))), (Pdu{0x90, 2}));
  EXPECT_TRUE(NothingWasAsked());
}

}  // namespace
}  // namespace granary
