#include "daemon/modbus/status.h"

#include <gtest/gtest.h>

#include "tests/daemon/modbus/snapshots.h"

namespace granary {
namespace {

using test::GoodSnapshot;
using test::HeldSnapshot;
using test::UnmeasuredSnapshot;

bool Bit(const BinSnapshot& snapshot, int bit) { return (StatusWord(snapshot) >> bit) & 1; }

TEST(StatusBitTable, BitsAreInOrder) {
  for (int bit = 0; bit < 16; ++bit) EXPECT_EQ(StatusBitTable()[bit].bit, bit);
}

TEST(StatusWord, GoodMeasurementIsValidAndNothingElse) { EXPECT_EQ(StatusWord(GoodSnapshot()), 1U << 0); }

TEST(StatusWord, BeforeAnyMeasurementThereIsNoneAndNothingElse) {
  EXPECT_EQ(StatusWord(UnmeasuredSnapshot()), 1U << 6);
}

TEST(StatusWord, FailedCycleHoldsAndIsNotValid) {
  EXPECT_FALSE(Bit(HeldSnapshot(Reason::kCoverageLow), 0));
  EXPECT_TRUE(Bit(HeldSnapshot(Reason::kCoverageLow), 1));
}

TEST(StatusWord, RestoredFigureIsHeld) {
  auto snapshot = GoodSnapshot();
  snapshot.last.reset();
  EXPECT_EQ(StatusWord(snapshot), 1U << 1);
}

TEST(StatusWord, StaleFigureIsNotValid) {
  auto snapshot = GoodSnapshot();
  snapshot.stale = true;
  EXPECT_EQ(StatusWord(snapshot), 1U << 3);
}

TEST(StatusWord, NothingIsHeldWhenTheFirstCycleFails) {
  auto snapshot = HeldSnapshot(Reason::kTooDark);
  snapshot.good.reset();
  EXPECT_FALSE(Bit(snapshot, 1));
  EXPECT_TRUE(Bit(snapshot, 6));
}

TEST(StatusWord, SaysWhatIsGoingOn) {
  auto snapshot = GoodSnapshot();
  snapshot.measuring = true;
  snapshot.maintenance = true;
  snapshot.good->simulated = true;
  snapshot.good->reduced_accuracy = true;
  for (const int bit : {2, 4, 5, 7}) EXPECT_TRUE(Bit(snapshot, bit)) << bit;
}

TEST(StatusWord, AbnormalStaysWithTheHeldFigure) {
  auto snapshot = HeldSnapshot(Reason::kTooDark);
  snapshot.good->abnormal = true;
  EXPECT_TRUE(Bit(snapshot, 8));
  EXPECT_TRUE(Bit(snapshot, 1));
}

TEST(StatusWord, LatchedAbnormalOutlivesTheActiveOne) {
  auto snapshot = GoodSnapshot();
  snapshot.abnormal_latched = true;
  EXPECT_FALSE(Bit(snapshot, 8));
  EXPECT_TRUE(Bit(snapshot, 9));
}

TEST(StatusWord, ChangeBeyondItsUncertaintyIsFillingOrEmptying) {
  auto snapshot = GoodSnapshot();  // u95 0.05 m³, so a difference of two is uncertain by 0.0707 m³
  snapshot.change_m3 = 0.08;
  EXPECT_TRUE(Bit(snapshot, 10));
  snapshot.change_m3 = -0.08;
  EXPECT_TRUE(Bit(snapshot, 11));
}

TEST(StatusWord, ChangeWithinItsUncertaintyIsNoMovement) {
  auto snapshot = GoodSnapshot();
  snapshot.change_m3 = 0.06;
  EXPECT_EQ(StatusWord(snapshot), 1U << 0);
}

TEST(StatusWord, HeldFigureDoesNotMove) {
  auto snapshot = HeldSnapshot(Reason::kTooDark);
  snapshot.change_m3 = 5;
  EXPECT_FALSE(Bit(snapshot, 10));
}

TEST(StatusWord, FaultBitFollowsTheKindOfTheReason) {
  EXPECT_TRUE(Bit(HeldSnapshot(Reason::kFrameMissing), 12));
  EXPECT_TRUE(Bit(HeldSnapshot(Reason::kProjectorFault), 13));
  EXPECT_TRUE(Bit(HeldSnapshot(Reason::kReferenceMissing), 14));
}

TEST(StatusWord, PoorPictureIsNoDeviceFault) {
  for (const int bit : {12, 13, 14}) EXPECT_FALSE(Bit(HeldSnapshot(Reason::kTooDark), bit)) << bit;
}

TEST(StatusWord, BookDataIsMissingWithoutBookOrDensity) {
  auto no_book = GoodSnapshot();
  no_book.good->book_mass_kg.reset();
  EXPECT_TRUE(Bit(no_book, 15));
  auto no_density = GoodSnapshot();
  no_density.good->density_kg_m3.reset();
  EXPECT_TRUE(Bit(no_density, 15));
}

TEST(NamurClassOf, GoodMeasurementIsOk) { EXPECT_EQ(NamurClassOf(GoodSnapshot()), NamurClass::kOk); }

TEST(NamurClassOf, DeviceFaultIsAFailure) {
  for (const Reason reason :
       {Reason::kCameraUnavailable, Reason::kProjectorDark, Reason::kCalibrationInvalid, Reason::kInternal}) {
    EXPECT_EQ(NamurClassOf(HeldSnapshot(reason)), NamurClass::kFailure) << InfoOf(reason).name;
  }
}

TEST(NamurClassOf, PoorPictureIsOutOfSpecificationWhileAFigureIsHeld) {
  EXPECT_EQ(NamurClassOf(HeldSnapshot(Reason::kCoverageLow)), NamurClass::kOutOfSpecification);
}

TEST(NamurClassOf, PoorPictureIsAFailureWhenThereIsNothingToHold) {
  auto snapshot = HeldSnapshot(Reason::kCoverageLow);
  snapshot.good.reset();
  EXPECT_EQ(NamurClassOf(snapshot), NamurClass::kFailure);
}

TEST(NamurClassOf, StaleRestoredOrLessAccurateIsOutOfSpecification) {
  auto stale = GoodSnapshot();
  stale.stale = true;
  EXPECT_EQ(NamurClassOf(stale), NamurClass::kOutOfSpecification);
  auto restored = GoodSnapshot();
  restored.last.reset();
  restored.held = true;
  EXPECT_EQ(NamurClassOf(restored), NamurClass::kOutOfSpecification);
  auto reduced = GoodSnapshot();
  reduced.good->reduced_accuracy = true;
  EXPECT_EQ(NamurClassOf(reduced), NamurClass::kOutOfSpecification);
}

TEST(NamurClassOf, InhibitedSimulatedOrUnmeasuredIsAFunctionCheck) {
  auto inhibited = GoodSnapshot();
  inhibited.maintenance = true;
  EXPECT_EQ(NamurClassOf(inhibited), NamurClass::kFunctionCheck);
  auto simulated = GoodSnapshot();
  simulated.good->simulated = true;
  EXPECT_EQ(NamurClassOf(simulated), NamurClass::kFunctionCheck);
  EXPECT_EQ(NamurClassOf(UnmeasuredSnapshot()), NamurClass::kFunctionCheck);
}

TEST(ValidityBits, OneForEachFigureThatExists) {
  auto snapshot = GoodSnapshot();
  EXPECT_EQ(ValidityBits(snapshot), 0b01111);
  snapshot.good->temperature_c = 12;
  snapshot.good->error_rate_percent.reset();
  EXPECT_EQ(ValidityBits(snapshot), 0b10111);
}

TEST(ValidityBits, HeldOrStaleFiguresAreNotValid) {
  EXPECT_EQ(ValidityBits(HeldSnapshot(Reason::kTooDark)), 0);
  auto stale = GoodSnapshot();
  stale.stale = true;
  EXPECT_EQ(ValidityBits(stale), 0);
  EXPECT_EQ(ValidityBits(UnmeasuredSnapshot()), 0);
}

TEST(StatusWord, InjectedFigureIsCurrentAndSimulated) {
  auto snapshot = GoodSnapshot();
  snapshot.injected = true;
  EXPECT_TRUE(Bit(snapshot, 0));
  EXPECT_TRUE(Bit(snapshot, 4));
}

TEST(CoilBits, AreTheStatusBitsAndThenTheAlarms) {
  auto snapshot = HeldSnapshot(Reason::kFrameMissing);
  snapshot.good->abnormal = true;
  EXPECT_EQ(CoilBits(snapshot), StatusWord(snapshot) | (1U << 16));
}

TEST(CoilBits, MeasureNowIsOnWhileThatCommandIsBusy) {
  auto snapshot = GoodSnapshot();
  snapshot.command = {BinCommand::kMeasure, CommandResult::kBusy};
  EXPECT_TRUE((CoilBits(snapshot) >> kMeasureCoil) & 1);
  snapshot.command.result = CommandResult::kDone;
  EXPECT_FALSE((CoilBits(snapshot) >> kMeasureCoil) & 1);
  snapshot.command = {BinCommand::kAcknowledge, CommandResult::kBusy};
  EXPECT_FALSE((CoilBits(snapshot) >> kMeasureCoil) & 1);
}

TEST(CoilBits, InhibitIsTheMaintenanceBit) {
  auto snapshot = GoodSnapshot();
  snapshot.maintenance = true;
  EXPECT_EQ(CoilBits(snapshot), StatusWord(snapshot) | (std::uint64_t{1} << kInhibitCoil));
}

}  // namespace
}  // namespace granary
